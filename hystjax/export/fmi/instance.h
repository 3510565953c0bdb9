/* What an FMU of either version is: a law, and the variables around it. */

#include <stdlib.h>
#include <string.h>

#include "law.c"

#if defined(_WIN32)
#define FMU_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMU_EXPORT __attribute__((visibility("default")))
#else
#define FMU_EXPORT
#endif

/* Value references. */
enum { FMU_U = 0, FMU_DU = 1, FMU_W = 2, FMU_W0 = 3, FMU_TIME = 4 };

typedef struct {
    law_state law;
    double u, du, w0, time;
    int running; /* past initialisation */
} fmu_instance;

static fmu_instance *fmu_new(const char *token)
{
    fmu_instance *fmu = NULL;

    if (token && strcmp(token, FMU_TOKEN) == 0) {
        fmu = calloc(1, sizeof *fmu);
    }
    return fmu;
}

/* The law at the start, which knows of the time if that has a say. */
static void fmu_begin(const fmu_instance *fmu, law_state *law)
{
    law_init(law, (law_real)fmu->u, (law_real)fmu->w0);
#ifdef LAW_TIMED
    law->t = (law_real)fmu->time;
#endif
}

static void fmu_start(fmu_instance *fmu)
{
    fmu_begin(fmu, &fmu->law);
    fmu->running = 1;
}

/* What may be set; NULL for all else. */
static double *fmu_given(fmu_instance *fmu, unsigned reference)
{
    switch (reference) {
    case FMU_U:
        return &fmu->u;
    case FMU_DU:
        return &fmu->du;
    case FMU_W0:
        return &fmu->w0;
    default:
        return NULL;
    }
}

static double fmu_output(const fmu_instance *fmu)
{
    law_state law = fmu->law;

    if (!fmu->running) {
        fmu_begin(fmu, &law);
    }
    return (double)law_output(&law, (law_real)fmu->du);
}

/* Each is false where there is no such variable, or it cannot be set. */

static int fmu_get(fmu_instance *fmu, unsigned reference, double *value)
{
    const double *given = fmu_given(fmu, reference);

    if (given) {
        *value = *given;
    } else if (reference == FMU_TIME) {
        *value = fmu->time;
    } else if (reference == FMU_W) {
        *value = fmu_output(fmu);
    } else {
        return 0;
    }
    return 1;
}

static int fmu_set(fmu_instance *fmu, unsigned reference, double value)
{
    double *given = fmu_given(fmu, reference);

    if (given) {
        *given = value;
    }
    return given != NULL;
}

static int fmu_get_all(fmu_instance *fmu, const unsigned references[], size_t n,
                       double values[])
{
    int good = 1;

    for (size_t i = 0; i < n; i++) {
        good = fmu_get(fmu, references[i], &values[i]) && good;
    }
    return good;
}

static int fmu_set_all(fmu_instance *fmu, const unsigned references[], size_t n,
                       const double values[])
{
    int good = 1;

    for (size_t i = 0; i < n; i++) {
        good = fmu_set(fmu, references[i], values[i]) && good;
    }
    return good;
}

/* The input goes straight from where it is to u + du h. */
static int fmu_step(fmu_instance *fmu, double time, double h)
{
    if (!law_step(&fmu->law, (law_real)(fmu->u + fmu->du * h), (law_real)h)) {
        return 0;
    }
    fmu->time = time + h;
    return 1;
}

static fmu_instance *fmu_copy(const fmu_instance *fmu)
{
    fmu_instance *copy = malloc(sizeof *copy);

    if (copy) {
        *copy = *fmu;
    }
    return copy;
}
