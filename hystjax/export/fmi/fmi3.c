/* Co-simulation by the Functional Mock-up Interface 3.0, https://fmi-standard.org: the
 * types and functions that it declares, around a law. */

#include <stdbool.h>
#include <stdint.h>

#include "functions.h"

typedef void *fmi3InstanceEnvironment;
typedef const char *fmi3String;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmu_status, fmi3String,
                                       fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, double, bool,
                                               bool, bool, bool, bool *, double *);
typedef void (*fmi3Callback)(fmi3InstanceEnvironment);
typedef void (*fmi3PreemptionCallback)(void);

/* Of variables of types that there are none of. */
#define NO_VARIABLES(name, type)                                                       \
    FUNCTION(fmu_status, name, void *c, const unsigned r[], size_t n,                  \
             type values, size_t m)                                                    \
    {                                                                                  \
        unused(c, r, values, m);                                                       \
        return STATUS(n == 0);                                                         \
    }

/* Of modes that this kind of FMU has not. */
#define NO_MODE(name)                                                                  \
    FUNCTION(fmu_status, name, void *c)                                                \
    {                                                                                  \
        unused(c);                                                                     \
        return FMU_ERROR;                                                              \
    }

FUNCTION(const char *, fmi3GetVersion, void)
{
    return "3.0";
}

FUNCTION(void *, fmi3InstantiateCoSimulation, fmi3String name, fmi3String token,
         fmi3String resources, bool visible, bool logging, bool events, bool early,
         const unsigned required[], size_t n, fmi3InstanceEnvironment around,
         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    unused(name, resources, visible, logging, early, required, n, around, log, update);
    return events ? NULL : fmu_new(token);
}

FUNCTION(void *, fmi3InstantiateModelExchange, fmi3String name, fmi3String token,
         fmi3String resources, bool visible, bool logging,
         fmi3InstanceEnvironment around, fmi3LogMessageCallback log)
{
    unused(name, token, resources, visible, logging, around, log);
    return NULL;
}

FUNCTION(void *, fmi3InstantiateScheduledExecution, fmi3String name,
         fmi3String token, fmi3String resources, bool visible, bool logging,
         fmi3InstanceEnvironment around, fmi3LogMessageCallback log,
         fmi3Callback clocks, fmi3PreemptionCallback lock,
         fmi3PreemptionCallback unlock)
{
    unused(name, token, resources, visible, logging, around, log, clocks, lock, unlock);
    return NULL;
}

FUNCTION(fmu_status, fmi3EnterInitializationMode, void *c, bool has_tolerance,
         double tolerance, double start, bool has_stop, double stop)
{
    unused(c, has_tolerance, tolerance, has_stop, stop);
    ((fmu_instance *)c)->time = start;
    return FMU_OK;
}

LIFE(fmi3, bool)

NO_MODE(fmi3EnterEventMode)
NO_MODE(fmi3EnterStepMode)
NO_MODE(fmi3EnterConfigurationMode)
NO_MODE(fmi3ExitConfigurationMode)
NO_MODE(fmi3EnterContinuousTimeMode)
NO_MODE(fmi3EvaluateDiscreteStates)

FUNCTION(fmu_status, fmi3GetFloat64, void *c, const unsigned r[],
         size_t n, double values[], size_t m)
{
    return STATUS(n == m && fmu_get_all(c, r, n, values));
}

FUNCTION(fmu_status, fmi3SetFloat64, void *c, const unsigned r[],
         size_t n, const double values[], size_t m)
{
    return STATUS(n == m && fmu_set_all(c, r, n, values));
}

NO_VARIABLES(fmi3GetFloat32, float *)
NO_VARIABLES(fmi3GetInt8, int8_t *)
NO_VARIABLES(fmi3GetUInt8, uint8_t *)
NO_VARIABLES(fmi3GetInt16, int16_t *)
NO_VARIABLES(fmi3GetUInt16, uint16_t *)
NO_VARIABLES(fmi3GetInt32, int32_t *)
NO_VARIABLES(fmi3GetUInt32, uint32_t *)
NO_VARIABLES(fmi3GetInt64, int64_t *)
NO_VARIABLES(fmi3GetUInt64, uint64_t *)
NO_VARIABLES(fmi3GetBoolean, bool *)
NO_VARIABLES(fmi3GetString, fmi3String *)
NO_VARIABLES(fmi3SetFloat32, const float *)
NO_VARIABLES(fmi3SetInt8, const int8_t *)
NO_VARIABLES(fmi3SetUInt8, const uint8_t *)
NO_VARIABLES(fmi3SetInt16, const int16_t *)
NO_VARIABLES(fmi3SetUInt16, const uint16_t *)
NO_VARIABLES(fmi3SetInt32, const int32_t *)
NO_VARIABLES(fmi3SetUInt32, const uint32_t *)
NO_VARIABLES(fmi3SetInt64, const int64_t *)
NO_VARIABLES(fmi3SetUInt64, const uint64_t *)
NO_VARIABLES(fmi3SetBoolean, const bool *)
NO_VARIABLES(fmi3SetString, const fmi3String *)

STATES(fmi3FreeFMUState, fmi3GetFMUState, fmi3SetFMUState)
SERIAL(fmi3SerializedFMUStateSize, fmi3SerializeFMUState, fmi3DeserializeFMUState,
       uint8_t)

FUNCTION(fmu_status, fmi3GetOutputDerivatives, void *c,
         const unsigned r[], size_t n, const int32_t orders[],
         double values[], size_t m)
{
    unused(c, r, orders, values, m);
    return STATUS(n == 0);
}

FUNCTION(fmu_status, fmi3DoStep, void *c, double time, double h, bool no_set,
         bool *event, bool *terminate, bool *early, double *last)
{
    const bool good = fmu_step(c, time, h) != 0;

    unused(c, no_set);
    *event = false;
    *terminate = false;
    *early = false;
    *last = good ? (time + h) : time;
    return STATUS(good);
}

/* What the standard asks for in every unit, and this kind has not. */
REFUSE_5(fmi3GetBinary, references, size_t, size_t *, const uint8_t **, size_t)
REFUSE_5(fmi3SetBinary, references, size_t, const size_t *, const uint8_t *const *,
         size_t)
REFUSE_3(fmi3GetClock, references, size_t, bool *)
REFUSE_3(fmi3SetClock, references, size_t, const bool *)
REFUSE_2(fmi3GetNumberOfVariableDependencies, unsigned, size_t *)
REFUSE_6(fmi3GetVariableDependencies, unsigned, size_t *,
         unsigned *, size_t *, int *, size_t)
REFUSE_8(fmi3GetDirectionalDerivative, references, size_t, references, size_t,
         const double *, size_t, double *, size_t)
REFUSE_8(fmi3GetAdjointDerivative, references, size_t, references, size_t,
         const double *, size_t, double *, size_t)
REFUSE_4(fmi3GetIntervalDecimal, references, size_t, double *, int *)
REFUSE_5(fmi3GetIntervalFraction, references, size_t, uint64_t *, uint64_t *, int *)
REFUSE_3(fmi3GetShiftDecimal, references, size_t, double *)
REFUSE_4(fmi3GetShiftFraction, references, size_t, uint64_t *, uint64_t *)
REFUSE_3(fmi3SetIntervalDecimal, references, size_t, const double *)
REFUSE_4(fmi3SetIntervalFraction, references, size_t, const uint64_t *,
         const uint64_t *)
REFUSE_3(fmi3SetShiftDecimal, references, size_t, const double *)
REFUSE_4(fmi3SetShiftFraction, references, size_t, const uint64_t *, const uint64_t *)
REFUSE_6(fmi3UpdateDiscreteStates, bool *, bool *, bool *, bool *, bool *, double *)
REFUSE_3(fmi3CompletedIntegratorStep, bool, bool *, bool *)
REFUSE_1(fmi3SetTime, double)
REFUSE_2(fmi3SetContinuousStates, const double *, size_t)
REFUSE_2(fmi3GetContinuousStateDerivatives, double *, size_t)
REFUSE_2(fmi3GetEventIndicators, double *, size_t)
REFUSE_2(fmi3GetContinuousStates, double *, size_t)
REFUSE_2(fmi3GetNominalsOfContinuousStates, double *, size_t)
REFUSE_1(fmi3GetNumberOfEventIndicators, size_t *)
REFUSE_1(fmi3GetNumberOfContinuousStates, size_t *)
REFUSE_2(fmi3ActivateModelPartition, unsigned, double)
