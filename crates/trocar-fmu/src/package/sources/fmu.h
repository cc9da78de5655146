/* One instance of the model, for both versions of FMI. variables.h says which variables there are; fmi2.c and fmi3.c
 * define fmu_reference and fmu_integer, their types for value references and for the mode, before they include this.
 *
 * A function that can refuse a call returns the reason, or 0 after it has done what it was asked for. Every pointer of
 * the importer but that to the instance is checked here. */

#ifndef FMU_H
#define FMU_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* The model is part of this file, and all its functions are static: several FMUs go into one program. */
#include "seal.c"

typedef enum { FMU_INSTANTIATED, FMU_INITIALIZATION, FMU_STEP, FMU_TERMINATED } fmu_phase;

/* Everything that a state of the FMU holds. */
typedef struct {
    char token[sizeof(FMU_TOKEN)]; /* of the model; bytes of another one are refused */
    fmu_phase phase;
    double time_s, stop_s, input, initial_position_m, turn;
    seal_state state;
} fmu_values;

/* Reasons given in several places. The logger of FMI 2.0 takes them for formats: none has a percent sign. */
#define FMU_UNKNOWN "there is no such variable of this type"
#define FMU_NOT_NOW "this function may not be called now"
#define FMU_FOREIGN "this is no state of this model"
#define FMU_ONLY "not supported: this FMU is for co-simulation only"

/* Value references. */
enum {
    FMU_TIME = 0,
    FMU_INPUT = 1,
    FMU_FORCE = 2,
    FMU_DEFLECTION = 3,
    FMU_MODE = 4,
    FMU_POSITION = 5,
    FMU_INITIAL_POSITION = 8,
    FMU_TURN = 9,
    FMU_TORQUE = 10
};

static const char *fmu_reset(fmu_values *fmu)
{
    memset(fmu, 0, sizeof *fmu);
    memcpy(fmu->token, FMU_TOKEN, sizeof FMU_TOKEN);
    fmu->phase = FMU_INSTANTIATED;
    fmu->stop_s = HUGE_VAL;
    seal_rest(&fmu->state, 0.0);
    return 0;
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
#if FMU_TURNS
        fmu->state.angle_rad = FMU_DRIVEN_BY_VELOCITY ? 0.0 : fmu->turn;
#endif
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
static fmu_integer fmu_mode(const fmu_values *fmu)
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

/* 1 if there is such a variable. */
static int fmu_get(const fmu_values *fmu, fmu_reference reference, double *value)
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
#if FMU_TURNS
    case FMU_TURN:
        *value = fmu->turn;
        return 1;
    case FMU_TORQUE:
        *value = fmu->state.torque_n_m;
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
static const char *fmu_refusal(const fmu_values *fmu, fmu_reference reference, double value)
{
    double present;
    const int is_input = reference == FMU_INPUT || reference == FMU_TURN;
    const int is_initial = FMU_DRIVEN_BY_VELOCITY && reference == FMU_INITIAL_POSITION;
    if (!fmu_get(fmu, reference, &present)) {
        return FMU_UNKNOWN;
    }
    if (!is_input && !is_initial) {
        return "this variable cannot be set; parameters are constants in an FMU with source code";
    }
    if (fmu->phase == FMU_TERMINATED || (is_initial && !fmu_is_before(fmu))) {
        return "this variable cannot be set any more";
    }
    return isfinite(value) ? 0 : "the value must be finite";
}

/* Whether there is one value for each reference, and both are there. */
static const char *fmu_check_values(const fmu_reference references[], size_t count, const void *values, size_t room)
{
    if (room != count) {
        return "there must be one value for each value reference";
    }
    if (count > 0 && !references) {
        return "null pointer for the value references";
    }
    return count > 0 && !values ? "null pointer for the values" : 0;
}

static const char *fmu_get_reals(fmu_values *fmu, const fmu_reference references[], size_t count, double values[],
                                 size_t room)
{
    const char *wrong = fmu_check_values(references, count, values, room);
    size_t k;
    for (k = 0; !wrong && k < count; ++k) {
        fmu_settle(fmu);
        wrong = fmu_get(fmu, references[k], &values[k]) ? 0 : FMU_UNKNOWN;
    }
    return wrong;
}

/* The only integer variable is the mode. */
static const char *fmu_get_integers(fmu_values *fmu, const fmu_reference references[], size_t count,
                                    fmu_integer values[], size_t room)
{
    const char *wrong = fmu_check_values(references, count, values, room);
    size_t k;
    for (k = 0; !wrong && k < count; ++k) {
        fmu_settle(fmu);
#if FMU_ELEMENTS > 0
        values[k] = fmu_mode(fmu);
        wrong = references[k] == FMU_MODE ? 0 : FMU_UNKNOWN;
#else
        wrong = FMU_UNKNOWN;
#endif
    }
    return wrong;
}

/* Sets all of them or none. */
static const char *fmu_set_reals(fmu_values *fmu, const fmu_reference references[], size_t count,
                                 const double values[], size_t room)
{
    const char *wrong = fmu_check_values(references, count, values, room);
    size_t k;
    for (k = 0; !wrong && k < count; ++k) {
        wrong = fmu_refusal(fmu, references[k], values[k]);
    }
    for (k = 0; !wrong && k < count; ++k) {
        *(references[k] == FMU_INPUT  ? &fmu->input
          : references[k] == FMU_TURN ? &fmu->turn
                                      : &fmu->initial_position_m) = values[k];
    }
    return wrong;
}

/* Why there can be no instance with this name and token; 0 if there can. */
static const char *fmu_refused_start(const char *name, const char *token)
{
    if (!name) {
        return "null pointer for the instance name";
    }
    if (!token) {
        return "null pointer for the GUID or token";
    }
    return strcmp(token, FMU_TOKEN) != 0 ? "the GUID or token is not that of this FMU" : 0;
}

/* Memory for an instance of `size` bytes, which begins with an fmu_values; 0 if there is none. */
static void *fmu_new(size_t size)
{
    void *fmu = calloc(1, size);
    if (fmu) {
        fmu_reset((fmu_values *)fmu);
    }
    return fmu;
}

static const char *fmu_enter(fmu_values *fmu, fmu_phase from, fmu_phase to)
{
    if (fmu->phase != from) {
        return FMU_NOT_NOW;
    }
    fmu_settle(fmu);
    fmu->phase = to;
    return 0;
}

/* Start and stop time; an infinite stop time is none. */
static const char *fmu_set_time(fmu_values *fmu, double start, double stop)
{
    if (fmu->phase != FMU_INSTANTIATED) {
        return FMU_NOT_NOW;
    }
    if (!isfinite(start) || isnan(stop) || stop <= start) {
        return "the start time must be finite, the stop time after it";
    }
    fmu->time_s = start;
    fmu->stop_s = stop;
    return 0;
}

/* Advances from `point` by `duration`; a step that is refused changes nothing. */
static const char *fmu_step(fmu_values *fmu, double point, double duration)
{
    double tolerance, displacement;
#if FMU_TURNS
    double angle;
#endif
    if (fmu->phase != FMU_STEP) {
        return FMU_NOT_NOW;
    }
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
    displacement = FMU_DRIVEN_BY_VELOCITY ? fmu->input * duration : fmu->input - fmu->state.position_m;
    if (!isfinite(fmu->state.position_m + displacement) || !isfinite(displacement / duration)) {
        return "the motion of the step is not finite";
    }
#if FMU_TURNS
    angle = FMU_DRIVEN_BY_VELOCITY ? fmu->state.angle_rad + fmu->turn * duration : fmu->turn;
    if (FMU_DRIVEN_BY_VELOCITY) {
        seal_advance_to(&fmu->state, fmu->state.position_m + displacement, displacement, angle, duration);
    } else {
        seal_turn_to(&fmu->state, fmu->input, angle, duration);
    }
    if (fmu->state.angle_rad != angle) {
        return "the rotation of the step is not finite";
    }
    (void)seal_step;
    (void)seal_step_to;
#else
    if (FMU_DRIVEN_BY_VELOCITY) {
        seal_step(&fmu->state, displacement, duration);
    } else {
        seal_step_to(&fmu->state, fmu->input, duration);
    }
#endif
    fmu->time_s = point + duration;
    return 0;
}

/* A copy of the instance in *place, in the state that is there or in a new one. */
static const char *fmu_get_state(fmu_values *fmu, void **place)
{
    if (!place) {
        return "null pointer for the place of the state";
    }
    if (!*place) {
        *place = malloc(sizeof *fmu);
    }
    if (!*place) {
        return "no memory for a state";
    }
    fmu_settle(fmu);
    memcpy(*place, fmu, sizeof *fmu);
    return 0;
}

static const char *fmu_set_state(fmu_values *fmu, const void *state)
{
    if (!state) {
        return "null pointer for the state";
    }
    if (memcmp(state, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
        return FMU_FOREIGN;
    }
    memcpy(fmu, state, sizeof *fmu);
    return 0;
}

/* Where there is no state there is nothing to free. */
static const char *fmu_free_state(void **place)
{
    if (place) {
        free(*place);
        *place = 0;
    }
    return 0;
}

static const char *fmu_state_size(const void *state, size_t *size)
{
    if (!state) {
        return "null pointer for the state";
    }
    if (!size) {
        return "null pointer for the size";
    }
    *size = sizeof(fmu_values);
    return 0;
}

static const char *fmu_to_bytes(const void *state, void *bytes, size_t size)
{
    if (!state) {
        return "null pointer for the state";
    }
    if (!bytes) {
        return "null pointer for the bytes of the state";
    }
    if (size < sizeof(fmu_values)) {
        return "a state needs more bytes";
    }
    memcpy(bytes, state, sizeof(fmu_values));
    return 0;
}

static const char *fmu_from_bytes(const void *bytes, size_t size, void **place)
{
    void *state;
    if (!place) {
        return "null pointer for the place of the state";
    }
    if (!bytes) {
        return "null pointer for the bytes of the state";
    }
    if (size != sizeof(fmu_values) || memcmp(bytes, FMU_TOKEN, sizeof FMU_TOKEN) != 0) {
        return FMU_FOREIGN;
    }
    state = malloc(size);
    if (!state) {
        return "no memory for a state";
    }
    memcpy(state, bytes, size);
    *place = state;
    return 0;
}

#endif
