/*
 * Everything a C program may do wrong and a library can notice: a status, no crash, a state as good as before.
 * Usage: faults NEWER.json
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

static trocar_model *plausible(void)
{
    trocar_model *model = NULL;
    REFUSED(OK, trocar_model_plausible(&model));
    return model;
}

static int same(const trocar_state *a, const trocar_state *b)
{
    return memcmp(a, b, sizeof *a) == 0;
}

static void pointers(void)
{
    trocar_model *model = plausible();
    trocar_model *made = NULL;
    trocar_state state, before;
    trocar_tunable tunable;
    double number = 0.0, numbers[TROCAR_STATE_NUMBERS];
    int32_t mode;
    size_t count;

    REFUSED(NULL_POINTER, trocar_state_init(NULL, &state, 0.0));
    REFUSED(NULL_POINTER, trocar_state_init(model, NULL, 0.0));
    REFUSED(MISALIGNED, trocar_state_init(model, ODD(trocar_state), 0.0));
    REFUSED(MISALIGNED, trocar_state_init(ODD(const trocar_model), &state, 0.0));
    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    before = state;
    REFUSED(NULL_POINTER, trocar_step(NULL, &state, 1e-5, 1e-3, &number));
    REFUSED(NULL_POINTER, trocar_step(model, NULL, 1e-5, 1e-3, &number));
    REFUSED(NULL_POINTER, trocar_step(model, &state, 1e-5, 1e-3, NULL));
    REFUSED(MISALIGNED, trocar_step(model, ODD(trocar_state), 1e-5, 1e-3, &number));
    REFUSED(MISALIGNED, trocar_step(model, &state, 1e-5, 1e-3, ODD(double)));
    REFUSED(NULL_POINTER, trocar_step_to(model, &state, 0.2, 1e-3, NULL));
    REFUSED(NULL_POINTER, trocar_step_velocity(model, &state, 0.2, 1e-3, NULL));
    REFUSED(NULL_POINTER, trocar_simulate(model, &state, 0.0, 1, NULL, &number, &number, &count));
    REFUSED(NULL_POINTER, trocar_simulate(model, &state, 0.0, 1, &number, NULL, &number, &count));
    REFUSED(NULL_POINTER, trocar_simulate(model, &state, 0.0, 1, &number, &number, NULL, NULL));
    REFUSED(MISALIGNED, trocar_simulate(model, &state, 0.0, 1, &number, &number, &number, ODD(size_t)));
    REFUSED(MISALIGNED, trocar_simulate(model, &state, 0.0, 1, &number, ODD(double), &number, NULL));
    REFUSED(OUT_OF_RANGE, trocar_simulate(model, &state, 0.0, SIZE_MAX, &number, &number, &number, NULL));
    REFUSED(NULL_POINTER, trocar_state_force(NULL, &number));
    REFUSED(NULL_POINTER, trocar_state_force(&state, NULL));
    REFUSED(MISALIGNED, trocar_state_position(&state, ODD(double)));
    REFUSED(NULL_POINTER, trocar_state_deflection(NULL, &state, &number));
    REFUSED(NULL_POINTER, trocar_state_mode(model, NULL, &mode));
    REFUSED(MISALIGNED, trocar_state_mode(model, &state, ODD(int32_t)));
    REFUSED(NULL_POINTER, trocar_state_save(&state, NULL, TROCAR_STATE_NUMBERS));
    REFUSED(OUT_OF_RANGE, trocar_state_save(&state, numbers, TROCAR_STATE_NUMBERS - 1));
    REFUSED(NULL_POINTER, trocar_state_restore(model, &state, NULL, TROCAR_STATE_NUMBERS, NULL, 0));
    REFUSED(NULL_POINTER, trocar_model_tunable_count(model, NULL));
    REFUSED(NULL_POINTER, trocar_model_tunable(model, 0, NULL));
    REFUSED(OUT_OF_RANGE, trocar_model_tunable(model, 1000, &tunable));
    REFUSED(NULL_POINTER, trocar_model_plausible(NULL));
    REFUSED(NULL_POINTER, trocar_model_load(NULL, &made, NULL, 0));
    REFUSED(NULL_POINTER, trocar_model_load("x", NULL, NULL, 0));
    REFUSED(NULL_POINTER, trocar_model_parse(NULL, 3, &made, NULL, 0));
    REFUSED(NULL_POINTER, trocar_model_tuned(model, NULL, 1, &made, NULL, 0));
    REFUSED(OUT_OF_RANGE, trocar_model_tuned(model, numbers, 1000, &made, NULL, 0));
    CHECK(trocar_model_kind(NULL) == NULL);
    CHECK(same(&state, &before));
    REFUSED(OK, trocar_model_free(model));
    REFUSED(OK, trocar_model_free(NULL));
}

static void numbers(void)
{
    static const double wild[] = {NAN, INFINITY, -INFINITY};
    trocar_model *model = plausible();
    trocar_state state, before;
    double force = 0.0, last = 0.0;
    size_t k;

    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    REFUSED(OK, trocar_step(model, &state, 1e-3, 1e-3, &last));
    before = state;
    for (k = 0; k < 3; k++) {
        force = NAN;
        REFUSED(NOT_FINITE, trocar_step(model, &state, wild[k], 1e-3, &force));
        CHECK(force == last);
        REFUSED(NOT_FINITE, trocar_step(model, &state, 1e-5, wild[k], &force));
        REFUSED(NOT_FINITE, trocar_step_to(model, &state, wild[k], 1e-3, &force));
        REFUSED(NOT_FINITE, trocar_step_to(model, &state, 0.2, wild[k], &force));
        REFUSED(NOT_FINITE, trocar_step_velocity(model, &state, wild[k], 1e-3, &force));
        REFUSED(NOT_FINITE, trocar_step_velocity(model, &state, 1.0, wild[k], &force));
        REFUSED(NOT_FINITE, trocar_state_init(model, &state, wild[k]));
        REFUSED(NOT_FINITE, trocar_state_init_at_force(model, &state, 0.1, wild[k]));
        REFUSED(NOT_FINITE, trocar_state_init_at_deflection(model, &state, 0.1, wild[k]));
    }
    REFUSED(DURATION_NOT_POSITIVE, trocar_step(model, &state, 1e-5, 0.0, &force));
    REFUSED(DURATION_NOT_POSITIVE, trocar_step(model, &state, 0.0, 0.0, &force));
    REFUSED(DURATION_NOT_POSITIVE, trocar_step(model, &state, 1e-5, -1e-3, &force));
    REFUSED(DURATION_NOT_POSITIVE, trocar_step_to(model, &state, 0.2, 0.0, &force));
    REFUSED(DURATION_NOT_POSITIVE, trocar_step_velocity(model, &state, 0.2, -0.0, &force));
    REFUSED(NOT_FINITE, trocar_step(model, &state, 1.0, DBL_MIN / 4, &force)); /* infinite velocity */
    REFUSED(NOT_FINITE, trocar_step_velocity(model, &state, DBL_MAX, 10.0, &force));
    CHECK(same(&state, &before) && force == last);
    REFUSED(OK, trocar_step(model, &state, DBL_MAX / 4, 1.0, &force)); /* absurd, but a number */
    CHECK(isfinite(force));
    REFUSED(OK, trocar_model_free(model));
}

static void states(void)
{
    trocar_model *model = plausible();
    trocar_model *tuned = NULL, *other = NULL;
    trocar_state state, before;
    double saved[TROCAR_STATE_NUMBERS], force = 1.0;
    const double half_width_m = 4e-3;
    char message[TROCAR_MESSAGE_SIZE];
    static const char lugre[] =
        "{\"format\": \"trocar-model\", \"version\": 1, \"origin\": {\"kind\": \"hand_made\", \"program\": \"a test\"},"
        " \"friction\": {\"kind\": \"dahl\", \"stiffness_n_m\": 700.0, \"coulomb_force_n\": 2.0, \"exponent\": 1.4,"
        " \"viscous_damping_n_s_m\": 5.0}}";

    memset(&state, 0, sizeof state);
    REFUSED(NOT_A_STATE, trocar_step(model, &state, 1e-5, 1e-3, &force));
    CHECK(force == 0.0);
    memset(&state, 0xff, sizeof state);
    REFUSED(NOT_A_STATE, trocar_step(model, &state, 1e-5, 1e-3, &force));
    REFUSED(NOT_A_STATE, trocar_state_force(&state, &force));
    REFUSED(NOT_A_STATE, trocar_state_save(&state, saved, TROCAR_STATE_NUMBERS));

    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    memset(&state.words[1], 0x7f, sizeof state - 8); /* the mark is right, the rest is not */
    CHECK(trocar_step(model, &state, 1e-5, 1e-3, &force) != TROCAR_STATUS_OK);
    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    memset(&state.words[2], 0xff, sizeof state - 16); /* mark and model are right, the numbers are NaN */
    REFUSED(NOT_A_STATE, trocar_step(model, &state, 1e-5, 1e-3, &force));
    CHECK(force == 0.0);
    REFUSED(NOT_A_STATE, trocar_state_force(&state, &force));

    message[0] = '\0';
    CHECK(trocar_model_parse(lugre, sizeof lugre - 1, &other, message, sizeof message) == TROCAR_STATUS_OK);
    CHECK(message[0] == '\0');
    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    REFUSED(OTHER_MODEL, trocar_step(other, &state, 1e-5, 1e-3, &force));
    REFUSED(OTHER_MODEL, trocar_state_deflection(other, &state, &force));
    REFUSED(OTHER_MODEL, trocar_simulate(other, &state, 0.0, 0, NULL, NULL, NULL, NULL));
    REFUSED(OK, trocar_state_save(&state, saved, TROCAR_STATE_NUMBERS));
    before = state;
    REFUSED(NOT_A_STATE, trocar_state_restore(other, &state, saved, TROCAR_STATE_NUMBERS, message, sizeof message));
    CHECK(strstr(message, "number 3") != NULL);
    saved[5] = NAN;
    REFUSED(NOT_A_STATE, trocar_state_restore(model, &state, saved, TROCAR_STATE_NUMBERS, message, sizeof message));
    CHECK(strstr(message, "NaN") != NULL);
    REFUSED(OUT_OF_RANGE, trocar_state_restore(model, &state, saved, 7, message, sizeof message));
    CHECK(strstr(message, "55 numbers, got 7") != NULL);
    CHECK(same(&state, &before));
    REFUSED(OK, trocar_state_init(other, &state, 0.1));
    REFUSED(UNSUPPORTED, trocar_state_deflection(other, &state, &force));
    REFUSED(UNSUPPORTED, trocar_state_init_at_deflection(other, &state, 0.1, 0.0));

    /* Under a tuned copy a state goes on. */
    REFUSED(OK, trocar_model_tuned(model, &half_width_m, 1, &tuned, message, sizeof message));
    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    REFUSED(OK, trocar_step(tuned, &state, 1e-5, 1e-3, &force));
    REFUSED(OK, trocar_model_free(other));
    REFUSED(OK, trocar_model_free(tuned));
    REFUSED(OK, trocar_model_free(model));
}

static void models(const char *newer)
{
    trocar_model *model = plausible(), *made = model;
    trocar_state state;
    const double negative = -1.0;
    char message[TROCAR_MESSAGE_SIZE], small[8];
    double force;

    REFUSED(MODEL_NEWER, trocar_model_load(newer, &made, message, sizeof message));
    CHECK(made == NULL && strstr(message, "another version") != NULL && strstr(message, newer) != NULL);
    REFUSED(MODEL_UNREADABLE, trocar_model_load("/no/such/model.json", &made, message, sizeof message));
    CHECK(strstr(message, "/no/such/model.json") != NULL);
    REFUSED(MODEL_UNREADABLE, trocar_model_load("", &made, small, sizeof small));
    CHECK(strlen(small) == sizeof small - 1);
    REFUSED(MODEL_INVALID, trocar_model_parse("{\n \"format\": 1,", 15, &made, message, sizeof message));
    CHECK(strstr(message, "line 2 column") != NULL);
    REFUSED(MODEL_INVALID, trocar_model_parse("\xff\xfe", 2, &made, message, sizeof message));
    REFUSED(MODEL_INVALID, trocar_model_parse("", 0, &made, NULL, 100));
    REFUSED(MODEL_INVALID, trocar_model_tuned(model, &negative, 1, &made, message, sizeof message));
    CHECK(strstr(message, "half_width_m must be finite and above 0 m, got -1 m") != NULL);

    /* What is no model. */
    REFUSED(OK, trocar_state_init(model, &state, 0.0));
    REFUSED(NOT_A_MODEL, trocar_step((const trocar_model *)(const void *)&state, &state, 1e-5, 1e-3, &force));
    CHECK(trocar_model_kind((const trocar_model *)(const void *)memset(&room, 0, sizeof room)) == NULL);
    CHECK(strcmp(trocar_model_kind(model), "ems") == 0);

    CHECK(strcmp(trocar_status_message(12345), "unknown status") == 0);
    CHECK(strcmp(trocar_status_message(-1), "unknown status") == 0);
    REFUSED(OK, trocar_model_free(model));
}

/* Restored states of any finite numbers: a step ends, and gives a finite force or a status. */
static void restored(void)
{
    trocar_model *model = plausible();
    double saved[TROCAR_STATE_NUMBERS], row[TROCAR_STATE_NUMBERS], force;
    unsigned long seed = 1;
    trocar_state state;
    int k, n;

    REFUSED(OK, trocar_state_init(model, &state, 0.0));
    REFUSED(OK, trocar_state_save(&state, saved, TROCAR_STATE_NUMBERS));
    for (k = 0; k < 2000; k++) {
        memcpy(row, saved, sizeof row);
        for (n = 1; n < TROCAR_STATE_NUMBERS; n++) {
            seed = (seed * 1103515245UL + 12345UL) & 0x7fffffffUL;
            if (n != 3 && n != 4 && n != 11 && seed % 3 == 0) {
                row[n] = ldexp((double)(seed >> 8) - 4e6, (int)(seed % 2000) - 1000);
            }
        }
        REFUSED(OK, trocar_state_restore(model, &state, row, TROCAR_STATE_NUMBERS, NULL, 0));
        for (n = 0; n < 10; n++) {
            force = NAN;
            trocar_step_velocity(model, &state, n % 2 == 0 ? 0.1 : -0.05, 1e-3, &force);
            CHECK(isfinite(force));
            REFUSED(OK, trocar_state_save(&state, row, TROCAR_STATE_NUMBERS));
        }
    }
    REFUSED(OK, trocar_model_free(model));
}

/* Whatever a legal model is, no step bars the next one. */
static void dahl(const char *coulomb_force, const char *exponent)
{
    trocar_model *model = NULL;
    trocar_state state;
    char text[512];
    double force;
    int n;

    snprintf(text, sizeof text,
             "{\"format\": \"trocar-model\", \"version\": 1, \"origin\": {\"kind\": \"hand_made\", \"program\": \"a test\"},"
             " \"friction\": {\"kind\": \"dahl\", \"stiffness_n_m\": 700.0, \"coulomb_force_n\": %s, \"exponent\": %s,"
             " \"viscous_damping_n_s_m\": 5.0}}",
             coulomb_force, exponent);
    REFUSED(OK, trocar_model_parse(text, strlen(text), &model, NULL, 0));
    REFUSED(OK, trocar_state_init_at_force(model, &state, 0.1, 10.0)); /* all that it can hold */
    for (n = 0; n < 10; n++) {
        REFUSED(OK, trocar_step(model, &state, n < 5 ? 1e-3 : -1e-3, 1e-3, &force));
    }
    REFUSED(OK, trocar_state_init(model, &state, 0.1));
    for (n = 0; n < 10; n++) {
        REFUSED(OK, trocar_step(model, &state, n < 5 ? 1e-3 : -1e-3, 1e-3, &force));
    }
    REFUSED(OK, trocar_model_free(model));
}

int main(int argc, char **argv)
{
    CHECK(argc == 2);
    CHECK(trocar_abi_version() == TROCAR_ABI_VERSION);
    pointers();
    numbers();
    states();
    models(argv[1]);
    restored();
    dahl("2.0", "1.4");
    dahl("1e-200", "1e308");
    return failed;
}
