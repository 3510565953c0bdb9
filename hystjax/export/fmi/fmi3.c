/* Co-simulation by the Functional Mock-up Interface 3.0, https://fmi-standard.org: the
 * types and functions that it declares, around a law. */

#include <stdbool.h>
#include <stdint.h>

#include "instance.h"

typedef void *fmi3Instance;
typedef void *fmi3FMUState;
typedef void *fmi3InstanceEnvironment;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef uint32_t fmi3ValueReference;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String,
                                       fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, double, bool,
                                               bool, bool, bool, bool *, double *);
typedef void (*fmi3Callback)(fmi3InstanceEnvironment);
typedef void (*fmi3PreemptionCallback)(void);

#define STATUS(condition) ((condition) ? fmi3OK : fmi3Error)

/* Declared and then defined, so that none is without a prototype. */
#define FUNCTION(type, name, ...)                                                      \
    FMU_EXPORT type name(__VA_ARGS__);                                                 \
    FMU_EXPORT type name(__VA_ARGS__)

/* Of variables of types that there are none of. */
#define NO_VARIABLES(name, type)                                                       \
    FUNCTION(fmi3Status, name, fmi3Instance c, const fmi3ValueReference r[], size_t n, \
             type values, size_t m)                                                    \
    {                                                                                  \
        (void)c;                                                                       \
        (void)r;                                                                       \
        (void)values;                                                                  \
        (void)m;                                                                       \
        return STATUS(n == 0);                                                         \
    }

/* Of modes that this kind of FMU has not. */
#define NO_MODE(name)                                                                  \
    FUNCTION(fmi3Status, name, fmi3Instance c)                                         \
    {                                                                                  \
        (void)c;                                                                       \
        return fmi3Error;                                                              \
    }

FUNCTION(const char *, fmi3GetVersion, void)
{
    return "3.0";
}

FUNCTION(fmi3Status, fmi3SetDebugLogging, fmi3Instance c, bool on, size_t n,
         const fmi3String categories[])
{
    (void)c;
    (void)on;
    (void)n;
    (void)categories;
    return fmi3OK;
}

FUNCTION(fmi3Instance, fmi3InstantiateCoSimulation, fmi3String name, fmi3String token,
         fmi3String resources, bool visible, bool logging, bool events, bool early,
         const fmi3ValueReference required[], size_t n, fmi3InstanceEnvironment around,
         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)early;
    (void)required;
    (void)n;
    (void)around;
    (void)log;
    (void)update;
    return events ? NULL : fmu_new(token);
}

FUNCTION(fmi3Instance, fmi3InstantiateModelExchange, fmi3String name, fmi3String token,
         fmi3String resources, bool visible, bool logging,
         fmi3InstanceEnvironment around, fmi3LogMessageCallback log)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)around;
    (void)log;
    return NULL;
}

FUNCTION(fmi3Instance, fmi3InstantiateScheduledExecution, fmi3String name,
         fmi3String token, fmi3String resources, bool visible, bool logging,
         fmi3InstanceEnvironment around, fmi3LogMessageCallback log,
         fmi3Callback clocks, fmi3PreemptionCallback lock,
         fmi3PreemptionCallback unlock)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)around;
    (void)log;
    (void)clocks;
    (void)lock;
    (void)unlock;
    return NULL;
}

FUNCTION(void, fmi3FreeInstance, fmi3Instance c)
{
    free(c);
}

FUNCTION(fmi3Status, fmi3EnterInitializationMode, fmi3Instance c, bool has_tolerance,
         double tolerance, double start, bool has_stop, double stop)
{
    (void)has_tolerance;
    (void)tolerance;
    (void)has_stop;
    (void)stop;
    ((fmu_instance *)c)->time = start;
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3ExitInitializationMode, fmi3Instance c)
{
    fmu_start(c);
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3Terminate, fmi3Instance c)
{
    (void)c;
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3Reset, fmi3Instance c)
{
    (void)memset(c, 0, sizeof(fmu_instance));
    return fmi3OK;
}

NO_MODE(fmi3EnterEventMode)
NO_MODE(fmi3EnterStepMode)
NO_MODE(fmi3EnterConfigurationMode)
NO_MODE(fmi3ExitConfigurationMode)
NO_MODE(fmi3EnterContinuousTimeMode)
NO_MODE(fmi3EvaluateDiscreteStates)

FUNCTION(fmi3Status, fmi3GetFloat64, fmi3Instance c, const fmi3ValueReference r[],
         size_t n, double values[], size_t m)
{
    return STATUS(n == m && fmu_get_all(c, r, n, values));
}

FUNCTION(fmi3Status, fmi3SetFloat64, fmi3Instance c, const fmi3ValueReference r[],
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

FUNCTION(fmi3Status, fmi3FreeFMUState, fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3GetFMUState, fmi3Instance c, fmi3FMUState *state)
{
    free(*state);
    *state = fmu_copy(c);
    return STATUS(*state);
}

FUNCTION(fmi3Status, fmi3SetFMUState, fmi3Instance c, fmi3FMUState state)
{
    (void)memcpy(c, state, sizeof(fmu_instance));
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3SerializedFMUStateSize, fmi3Instance c, fmi3FMUState state,
         size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(fmu_instance);
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3SerializeFMUState, fmi3Instance c, fmi3FMUState state,
         fmi3Byte bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(fmu_instance)) {
        return fmi3Error;
    }
    (void)memcpy(bytes, state, sizeof(fmu_instance));
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3DeserializeFMUState, fmi3Instance c, const fmi3Byte bytes[],
         size_t size, fmi3FMUState *state)
{
    if (size < sizeof(fmu_instance)) {
        return fmi3Error;
    }
    if (!*state) {
        *state = fmu_copy(c);
    }
    if (!*state) {
        return fmi3Error;
    }
    (void)memcpy(*state, bytes, sizeof(fmu_instance));
    return fmi3OK;
}

FUNCTION(fmi3Status, fmi3GetOutputDerivatives, fmi3Instance c,
         const fmi3ValueReference r[], size_t n, const int32_t orders[],
         double values[], size_t m)
{
    (void)c;
    (void)r;
    (void)orders;
    (void)values;
    (void)m;
    return STATUS(n == 0);
}

FUNCTION(fmi3Status, fmi3DoStep, fmi3Instance c, double time, double h, bool no_set,
         bool *event, bool *terminate, bool *early, double *last)
{
    const bool good = fmu_step(c, time, h) != 0;

    (void)no_set;
    *event = false;
    *terminate = false;
    *early = false;
    *last = good ? (time + h) : time;
    return STATUS(good);
}

/* What the standard asks for in every unit, and this kind has not: refused, whatever
 * the arguments. */
#define REFUSE_1(name, A)                                                              \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a)                                    \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        return fmi3Error;                                                              \
    }
#define REFUSE_2(name, A, B)                                                           \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a, B b)                               \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        return fmi3Error;                                                              \
    }
#define REFUSE_3(name, A, B, C)                                                        \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a, B b, C third)                      \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        return fmi3Error;                                                              \
    }
#define REFUSE_4(name, A, B, C, D)                                                     \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a, B b, C third, D d)                 \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        return fmi3Error;                                                              \
    }
#define REFUSE_5(name, A, B, C, D, E)                                                  \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a, B b, C third, D d, E e)            \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        (void)e;                                                                       \
        return fmi3Error;                                                              \
    }
#define REFUSE_6(name, A, B, C, D, E, F)                                               \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a, B b, C third, D d, E e, F f)       \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        (void)e;                                                                       \
        (void)f;                                                                       \
        return fmi3Error;                                                              \
    }
#define REFUSE_8(name, A, B, C, D, E, F, G, H)                                         \
    FUNCTION(fmi3Status, name, fmi3Instance c, A a, B b, C third, D d, E e, F f, G g,  \
             H h)                                                                      \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        (void)e;                                                                       \
        (void)f;                                                                       \
        (void)g;                                                                       \
        (void)h;                                                                       \
        return fmi3Error;                                                              \
    }

typedef const fmi3ValueReference *references;

REFUSE_5(fmi3GetBinary, references, size_t, size_t *, const fmi3Byte **, size_t)
REFUSE_5(fmi3SetBinary, references, size_t, const size_t *, const fmi3Byte *const *,
         size_t)
REFUSE_3(fmi3GetClock, references, size_t, bool *)
REFUSE_3(fmi3SetClock, references, size_t, const bool *)
REFUSE_2(fmi3GetNumberOfVariableDependencies, fmi3ValueReference, size_t *)
REFUSE_6(fmi3GetVariableDependencies, fmi3ValueReference, size_t *,
         fmi3ValueReference *, size_t *, int *, size_t)
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
REFUSE_2(fmi3ActivateModelPartition, fmi3ValueReference, double)
