/* How the functions of both versions of the interface are written, which have other
 * names but the same statuses, and states that are copies. */

#include "instance.h"

typedef enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR, FMU_FATAL } fmu_status;
typedef const unsigned *references;

#define STATUS(condition) ((condition) ? FMU_OK : FMU_ERROR)

/* Declared and then defined, so that none is without a prototype. */
#define FUNCTION(type, name, ...)                                                      \
    FMU_EXPORT type name(__VA_ARGS__);                                                 \
    FMU_EXPORT type name(__VA_ARGS__)

/* What the interface hands over and a law has no use for; a pointer comes first. */
static void unused(const void *first, ...)
{
    (void)first;
}

/* What happens to a unit from its making to its end, after its first input. */
#define LIFE(version, truth)                                                           \
    FUNCTION(fmu_status, version##SetDebugLogging, void *c, truth on, size_t n,        \
             const char *const categories[])                                           \
    {                                                                                  \
        unused(c, on, n, categories);                                                  \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, version##ExitInitializationMode, void *c)                     \
    {                                                                                  \
        fmu_start(c);                                                                  \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, version##Terminate, void *c)                                  \
    {                                                                                  \
        unused(c);                                                                     \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, version##Reset, void *c)                                      \
    {                                                                                  \
        (void)memset(c, 0, sizeof(fmu_instance));                                      \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(void, version##FreeInstance, void *c)                                     \
    {                                                                                  \
        free(c);                                                                       \
    }

/* States, as copies of the whole. */
#define STATES(release, keep, restore)                                                 \
    FUNCTION(fmu_status, release, void *c, void **state)                               \
    {                                                                                  \
        unused(c);                                                                     \
        free(*state);                                                                  \
        *state = NULL;                                                                 \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, keep, void *c, void **state)                                  \
    {                                                                                  \
        free(*state);                                                                  \
        *state = fmu_copy(c);                                                          \
        return STATUS(*state);                                                         \
    }                                                                                  \
    FUNCTION(fmu_status, restore, void *c, void *state)                                \
    {                                                                                  \
        (void)memcpy(c, state, sizeof(fmu_instance));                                  \
        return FMU_OK;                                                                 \
    }

/* And as bytes. */
#define SERIAL(length, write, read, byte)                                              \
    FUNCTION(fmu_status, length, void *c, void *state, size_t *size)                   \
    {                                                                                  \
        unused(c, state);                                                              \
        *size = sizeof(fmu_instance);                                                  \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, write, void *c, void *state, byte bytes[], size_t size)       \
    {                                                                                  \
        unused(c);                                                                     \
        if (size < sizeof(fmu_instance)) {                                             \
            return FMU_ERROR;                                                          \
        }                                                                              \
        (void)memcpy(bytes, state, sizeof(fmu_instance));                              \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, read, void *c, const byte bytes[], size_t size, void **state) \
    {                                                                                  \
        if (size < sizeof(fmu_instance)) {                                             \
            return FMU_ERROR;                                                          \
        }                                                                              \
        if (!*state) {                                                                 \
            *state = fmu_copy(c);                                                      \
        }                                                                              \
        if (!*state) {                                                                 \
            return FMU_ERROR;                                                          \
        }                                                                              \
        (void)memcpy(*state, bytes, sizeof(fmu_instance));                             \
        return FMU_OK;                                                                 \
    }

/* Refused, whatever the arguments. */
#define REFUSE_1(name, A)                                                              \
    FUNCTION(fmu_status, name, void *c, A a)                                           \
    {                                                                                  \
        unused(c, a);                                                                  \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_2(name, A, B)                                                           \
    FUNCTION(fmu_status, name, void *c, A a, B b)                                      \
    {                                                                                  \
        unused(c, a, b);                                                               \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_3(name, A, B, C)                                                        \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third)                             \
    {                                                                                  \
        unused(c, a, b, third);                                                        \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_4(name, A, B, C, D)                                                     \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d)                        \
    {                                                                                  \
        unused(c, a, b, third, d);                                                     \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_5(name, A, B, C, D, E)                                                  \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d, E e)                   \
    {                                                                                  \
        unused(c, a, b, third, d, e);                                                  \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_6(name, A, B, C, D, E, F)                                               \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d, E e, F f)              \
    {                                                                                  \
        unused(c, a, b, third, d, e, f);                                               \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_8(name, A, B, C, D, E, F, G, H)                                         \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d, E e, F f, G g, H h)    \
    {                                                                                  \
        unused(c, a, b, third, d, e, f, g, h);                                         \
        return FMU_ERROR;                                                              \
    }
