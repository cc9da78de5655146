/* One instance of the model, for both versions of FMI. variables.h says which variables there are. */

#ifndef FMU_H
#define FMU_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "seal.h"
#include "variables.h"

typedef enum { FMU_INSTANTIATED, FMU_INITIALIZATION, FMU_STEP, FMU_TERMINATED } fmu_phase;

/* Everything that a state of the FMU holds. */
typedef struct {
    char token[sizeof(FMU_TOKEN)]; /* of the model; bytes of another one are refused */
    fmu_phase phase;
    double time_s, stop_s, input, initial_position_m;
    seal_state state;
} fmu_values;

/* Value references. */
enum {
    FMU_TIME = 0,
    FMU_INPUT = 1,
    FMU_FORCE = 2,
    FMU_DEFLECTION = 3,
    FMU_MODE = 4,
    FMU_POSITION = 5,
    FMU_INITIAL_POSITION = 8
};

static void fmu_reset(fmu_values *fmu)
{
    memset(fmu, 0, sizeof *fmu);
    memcpy(fmu->token, FMU_TOKEN, sizeof FMU_TOKEN);
    fmu->phase = FMU_INSTANTIATED;
    fmu->stop_s = HUGE_VAL;
    seal_rest(&fmu->state, 0.0);
}

static int fmu_is_before(const fmu_values *fmu)
{
    return fmu->phase == FMU_INSTANTIATED || fmu->phase == FMU_INITIALIZATION;
}

/* Before the first step the seal is at rest where the instrument stands. */
static void fmu_settle(fmu_values *fmu)
{
    if (fmu_is_before(fmu)) {
        seal_rest(&fmu->state, FMU_DRIVEN_BY_VELOCITY ? fmu->initial_position_m : fmu->input);
    }
}

#if FMU_ELEMENTS > 0
static double fmu_deflection(const fmu_values *fmu)
{
    double sum = -0.0;
    int k;
    for (k = 0; k < FMU_ELEMENTS; ++k) {
        sum += fmu->state.element[k].deflection_m;
    }
    return sum / (double)FMU_ELEMENTS;
}

/* 1 deforming, 2 sliding, once every element does. */
static int fmu_mode(const fmu_values *fmu)
{
    int k;
    for (k = 0; k < FMU_ELEMENTS; ++k) {
        if (!fmu->state.element[k].sliding) {
            return 1;
        }
    }
    return 2;
}
#endif

/* The integer variable, the mode. 1 if `reference` is it. */
static int fmu_get_integer(const fmu_values *fmu, unsigned reference, int *value)
{
#if FMU_ELEMENTS > 0
    *value = fmu_mode(fmu);
    return reference == FMU_MODE;
#else
    (void)fmu;
    (void)reference;
    *value = 0;
    return 0;
#endif
}

/* 1 if there is such a variable. */
static int fmu_get(const fmu_values *fmu, unsigned reference, double *value)
{
    size_t k;
    switch (reference) {
    case FMU_TIME:
        *value = fmu->time_s;
        return 1;
    case FMU_INPUT:
        *value = fmu->input;
        return 1;
    case FMU_FORCE:
        *value = fmu->state.force_n;
        return 1;
#if FMU_ELEMENTS > 0
    case FMU_DEFLECTION:
        *value = fmu_deflection(fmu);
        return 1;
#endif
#if FMU_DRIVEN_BY_VELOCITY
    case FMU_POSITION:
        *value = fmu->state.position_m;
        return 1;
    case FMU_INITIAL_POSITION:
        *value = fmu->initial_position_m;
        return 1;
#endif
    default:
        break;
    }
    for (k = 0; k < sizeof fmu_constants / sizeof fmu_constants[0]; ++k) {
        if (fmu_constants[k].reference == reference) {
            *value = fmu_constants[k].value;
            return 1;
        }
    }
    return 0;
}

/* Why a variable cannot be set to this value now; 0 if it can. */
static const char *fmu_refusal(const fmu_values *fmu, unsigned reference, double value)
{
    double present;
    const int is_input = reference == FMU_INPUT;
    const int is_initial = FMU_DRIVEN_BY_VELOCITY && reference == FMU_INITIAL_POSITION;
    if (!fmu_get(fmu, reference, &present)) {
        return "there is no such variable of this type";
    }
    if (!is_input && !is_initial) {
        return "this variable cannot be set; parameters are constants in an FMU with source code";
    }
    if (fmu->phase == FMU_TERMINATED || (is_initial && !fmu_is_before(fmu))) {
        return "this variable cannot be set any more";
    }
    return isfinite(value) ? 0 : "the value must be finite";
}

static void fmu_put(fmu_values *fmu, unsigned reference, double value)
{
    if (reference == FMU_INPUT) {
        fmu->input = value;
    } else {
        fmu->initial_position_m = value;
    }
}

/* Start and stop time; an infinite stop time is none. Returns what is wrong, or 0. */
static const char *fmu_set_time(fmu_values *fmu, double start, double stop)
{
    if (!isfinite(start) || isnan(stop) || stop <= start) {
        return "start and stop time must be finite and in order";
    }
    fmu->time_s = start;
    fmu->stop_s = stop;
    return 0;
}

/* Advances from `point` by `duration`. Returns what is wrong, or 0; the state is then as before. */
static const char *fmu_step(fmu_values *fmu, double point, double duration)
{
    double tolerance, displacement;
    if (!(duration > 0.0 && isfinite(duration))) {
        return "the step must be longer than 0 and finite";
    }
    tolerance = 1e-6 * duration + 1e-9 * fabs(point); /* rounding of an importer that adds up its steps */
    if (!isfinite(point) || fabs(point - fmu->time_s) > tolerance) {
        return "the step must begin at the present time";
    }
    if (point + duration > fmu->stop_s + tolerance) {
        return "the step goes beyond the stop time";
    }
#if FMU_DRIVEN_BY_VELOCITY
    displacement = fmu->input * duration;
#else
    displacement = fmu->input - fmu->state.position_m;
#endif
    if (!isfinite(fmu->state.position_m + displacement) || !isfinite(displacement / duration)) {
        return "the motion of the step is not finite";
    }
#if FMU_DRIVEN_BY_VELOCITY
    seal_step(&fmu->state, displacement, duration);
#else
    seal_step_to(&fmu->state, fmu->input, duration);
#endif
    fmu->time_s = point + duration;
    return 0;
}

#endif
