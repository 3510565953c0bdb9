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

/* States, as copies of the whole. */
#define STATES(release, keep, restore)                                                 \
    FUNCTION(fmu_status, release, void *c, void **state)                               \
    {                                                                                  \
        (void)c;                                                                       \
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
        (void)c;                                                                       \
        (void)state;                                                                   \
        *size = sizeof(fmu_instance);                                                  \
        return FMU_OK;                                                                 \
    }                                                                                  \
    FUNCTION(fmu_status, write, void *c, void *state, byte bytes[], size_t size)       \
    {                                                                                  \
        (void)c;                                                                       \
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
        (void)c;                                                                       \
        (void)a;                                                                       \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_2(name, A, B)                                                           \
    FUNCTION(fmu_status, name, void *c, A a, B b)                                      \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_3(name, A, B, C)                                                        \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third)                             \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_4(name, A, B, C, D)                                                     \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d)                        \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_5(name, A, B, C, D, E)                                                  \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d, E e)                   \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        (void)e;                                                                       \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_6(name, A, B, C, D, E, F)                                               \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d, E e, F f)              \
    {                                                                                  \
        (void)c;                                                                       \
        (void)a;                                                                       \
        (void)b;                                                                       \
        (void)third;                                                                   \
        (void)d;                                                                       \
        (void)e;                                                                       \
        (void)f;                                                                       \
        return FMU_ERROR;                                                              \
    }
#define REFUSE_8(name, A, B, C, D, E, F, G, H)                                         \
    FUNCTION(fmu_status, name, void *c, A a, B b, C third, D d, E e, F f, G g,         \
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
        return FMU_ERROR;                                                              \
    }
