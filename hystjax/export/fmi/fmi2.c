/* Co-simulation by the Functional Mock-up Interface 2.0.4, https://fmi-standard.org:
 * the types and functions that it declares, around a law. */

#include "functions.h"

typedef const char *fmi2String;

typedef struct {
    void (*logger)(void *, fmi2String, fmu_status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *, fmu_status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

/* Of variables of types that there are none of. */
#define NO_VARIABLES(name, type)                                                       \
    FUNCTION(fmu_status, name, void *c, const unsigned r[],                            \
             size_t n, type values)                                                    \
    {                                                                                  \
        unused(c, r, values);                                                          \
        return STATUS(n == 0);                                                         \
    }

/* Of questions that are only asked of steps that go on in the background. */
#define NO_STATUS(name, type)                                                          \
    FUNCTION(fmu_status, name, void *c, int kind, type value)                          \
    {                                                                                  \
        unused(c, kind, value);                                                        \
        return FMU_DISCARD;                                                            \
    }

FUNCTION(const char *, fmi2GetTypesPlatform, void)
{
    return "default";
}

FUNCTION(const char *, fmi2GetVersion, void)
{
    return "2.0";
}

FUNCTION(void *, fmi2Instantiate, fmi2String name, int type, fmi2String guid,
         fmi2String resources, const fmi2CallbackFunctions *functions, int visible,
         int logging)
{
    unused(name, resources, functions, visible, logging);
    return (type == 1) ? fmu_new(guid) : NULL;
}

FUNCTION(fmu_status, fmi2SetupExperiment, void *c, int has_tolerance,
         double tolerance, double start, int has_stop, double stop)
{
    unused(c, has_tolerance, tolerance, has_stop, stop);
    ((fmu_instance *)c)->time = start;
    return FMU_OK;
}

FUNCTION(fmu_status, fmi2EnterInitializationMode, void *c)
{
    unused(c);
    return FMU_OK;
}

LIFE(fmi2, int)

FUNCTION(fmu_status, fmi2GetReal, void *c, const unsigned r[],
         size_t n, double values[])
{
    return STATUS(fmu_get_all(c, r, n, values));
}

FUNCTION(fmu_status, fmi2SetReal, void *c, const unsigned r[],
         size_t n, const double values[])
{
    return STATUS(fmu_set_all(c, r, n, values));
}

NO_VARIABLES(fmi2GetInteger, int *)
NO_VARIABLES(fmi2GetBoolean, int *)
NO_VARIABLES(fmi2GetString, fmi2String *)
NO_VARIABLES(fmi2SetInteger, const int *)
NO_VARIABLES(fmi2SetBoolean, const int *)
NO_VARIABLES(fmi2SetString, const fmi2String *)

STATES(fmi2FreeFMUstate, fmi2GetFMUstate, fmi2SetFMUstate)
SERIAL(fmi2SerializedFMUstateSize, fmi2SerializeFMUstate, fmi2DeSerializeFMUstate, char)

REFUSE_6(fmi2GetDirectionalDerivative, references, size_t, references, size_t,
         const double *, double *)

FUNCTION(fmu_status, fmi2SetRealInputDerivatives, void *c,
         const unsigned r[], size_t n, const int order[],
         const double values[])
{
    for (size_t i = 0; i < n; i++) {
        if (r[i] != FMU_U || order[i] != 1) {
            return FMU_ERROR;
        }
        ((fmu_instance *)c)->du = values[i];
    }
    return FMU_OK;
}

FUNCTION(fmu_status, fmi2GetRealOutputDerivatives, void *c,
         const unsigned r[], size_t n, const int order[], double values[])
{
    unused(c, r, order, values);
    return STATUS(n == 0);
}

FUNCTION(fmu_status, fmi2DoStep, void *c, double time, double h, int no_set)
{
    unused(c, no_set);
    return STATUS(fmu_step(c, time, h));
}

FUNCTION(fmu_status, fmi2CancelStep, void *c)
{
    unused(c);
    return FMU_ERROR;
}

NO_STATUS(fmi2GetStatus, fmu_status *)
NO_STATUS(fmi2GetRealStatus, double *)
NO_STATUS(fmi2GetIntegerStatus, int *)
NO_STATUS(fmi2GetBooleanStatus, int *)
NO_STATUS(fmi2GetStringStatus, fmi2String *)
