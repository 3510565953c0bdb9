/* Co-simulation by the Functional Mock-up Interface 2.0.4, https://fmi-standard.org:
 * the types and functions that it declares, around a law. */

#include "instance.h"

typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef unsigned fmi2ValueReference;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error } fmi2Status;

typedef struct {
    void (*logger)(void *, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

#define STATUS(condition) ((condition) ? fmi2OK : fmi2Error)

/* Declared and then defined, so that none is without a prototype. */
#define FUNCTION(type, name, ...)                                                      \
    FMU_EXPORT type name(__VA_ARGS__);                                                 \
    FMU_EXPORT type name(__VA_ARGS__)

/* Of variables of types that there are none of. */
#define NO_VARIABLES(name, type)                                                       \
    FUNCTION(fmi2Status, name, fmi2Component c, const fmi2ValueReference r[],          \
             size_t n, type values)                                                    \
    {                                                                                  \
        (void)c;                                                                       \
        (void)r;                                                                       \
        (void)values;                                                                  \
        return STATUS(n == 0);                                                         \
    }

/* Of questions that are only asked of steps that go on in the background. */
#define NO_STATUS(name, type)                                                          \
    FUNCTION(fmi2Status, name, fmi2Component c, int kind, type value)                  \
    {                                                                                  \
        (void)c;                                                                       \
        (void)kind;                                                                    \
        (void)value;                                                                   \
        return fmi2Discard;                                                            \
    }

FUNCTION(const char *, fmi2GetTypesPlatform, void)
{
    return "default";
}

FUNCTION(const char *, fmi2GetVersion, void)
{
    return "2.0";
}

FUNCTION(fmi2Status, fmi2SetDebugLogging, fmi2Component c, int on, size_t n,
         const fmi2String categories[])
{
    (void)c;
    (void)on;
    (void)n;
    (void)categories;
    return fmi2OK;
}

FUNCTION(fmi2Component, fmi2Instantiate, fmi2String name, int type, fmi2String guid,
         fmi2String resources, const fmi2CallbackFunctions *functions, int visible,
         int logging)
{
    (void)name;
    (void)resources;
    (void)functions;
    (void)visible;
    (void)logging;
    return (type == 1) ? fmu_new(guid) : NULL;
}

FUNCTION(void, fmi2FreeInstance, fmi2Component c)
{
    free(c);
}

FUNCTION(fmi2Status, fmi2SetupExperiment, fmi2Component c, int has_tolerance,
         double tolerance, double start, int has_stop, double stop)
{
    (void)has_tolerance;
    (void)tolerance;
    (void)has_stop;
    (void)stop;
    ((fmu_instance *)c)->time = start;
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2EnterInitializationMode, fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2ExitInitializationMode, fmi2Component c)
{
    fmu_start(c);
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2Terminate, fmi2Component c)
{
    (void)c;
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2Reset, fmi2Component c)
{
    (void)memset(c, 0, sizeof(fmu_instance));
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2GetReal, fmi2Component c, const fmi2ValueReference r[],
         size_t n, double values[])
{
    return STATUS(fmu_get_all(c, r, n, values));
}

FUNCTION(fmi2Status, fmi2SetReal, fmi2Component c, const fmi2ValueReference r[],
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

FUNCTION(fmi2Status, fmi2FreeFMUstate, fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2GetFMUstate, fmi2Component c, fmi2FMUstate *state)
{
    free(*state);
    *state = fmu_copy(c);
    return STATUS(*state);
}

FUNCTION(fmi2Status, fmi2SetFMUstate, fmi2Component c, fmi2FMUstate state)
{
    (void)memcpy(c, state, sizeof(fmu_instance));
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate state,
         size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(fmu_instance);
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate state,
         fmi2Byte bytes[], size_t size)
{
    (void)c;
    if (size < sizeof(fmu_instance)) {
        return fmi2Error;
    }
    (void)memcpy(bytes, state, sizeof(fmu_instance));
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte bytes[],
         size_t size, fmi2FMUstate *state)
{
    if (size < sizeof(fmu_instance)) {
        return fmi2Error;
    }
    if (!*state) {
        *state = fmu_copy(c);
    }
    if (!*state) {
        return fmi2Error;
    }
    (void)memcpy(*state, bytes, sizeof(fmu_instance));
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2GetDirectionalDerivative, fmi2Component c,
         const fmi2ValueReference unknown[], size_t n, const fmi2ValueReference known[],
         size_t m, const double seed[], double sensitivity[])
{
    (void)c;
    (void)unknown;
    (void)n;
    (void)known;
    (void)m;
    (void)seed;
    (void)sensitivity;
    return fmi2Error;
}

FUNCTION(fmi2Status, fmi2SetRealInputDerivatives, fmi2Component c,
         const fmi2ValueReference r[], size_t n, const int order[],
         const double values[])
{
    for (size_t i = 0; i < n; i++) {
        if (r[i] != FMU_U || order[i] != 1) {
            return fmi2Error;
        }
        ((fmu_instance *)c)->du = values[i];
    }
    return fmi2OK;
}

FUNCTION(fmi2Status, fmi2GetRealOutputDerivatives, fmi2Component c,
         const fmi2ValueReference r[], size_t n, const int order[], double values[])
{
    (void)c;
    (void)r;
    (void)order;
    (void)values;
    return STATUS(n == 0);
}

FUNCTION(fmi2Status, fmi2DoStep, fmi2Component c, double time, double h, int no_set)
{
    (void)no_set;
    return STATUS(fmu_step(c, time, h));
}

FUNCTION(fmi2Status, fmi2CancelStep, fmi2Component c)
{
    (void)c;
    return fmi2Error;
}

NO_STATUS(fmi2GetStatus, fmi2Status *)
NO_STATUS(fmi2GetRealStatus, double *)
NO_STATUS(fmi2GetIntegerStatus, int *)
NO_STATUS(fmi2GetBooleanStatus, int *)
NO_STATUS(fmi2GetStringStatus, fmi2String *)
