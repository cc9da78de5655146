/*
 * Everything a C program may do wrong with a compensator and a library can notice, and faults of sensors, which are no
 * errors. Usage: compensator MODEL.json (one without a stated error of its force)
 */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "check.h"

static trocar_model *model;

static trocar_compensator_options plain(void)
{
    trocar_compensator_options options;
    REFUSED(OK, trocar_compensator_options_init(&options, sizeof options));
    options.force_error_n = 0.05;
    return options;
}

static trocar_compensator *made(void)
{
    const trocar_compensator_options options = plain();
    trocar_compensator *observer = NULL;
    REFUSED(OK, trocar_compensator_new(model, &options, &observer, NULL, 0));
    return observer;
}

static int knows_nothing(const trocar_estimate *said)
{
    return said->trocar_force_n == 0.0 && isnan(said->tissue_force_n) && isnan(said->tissue_force_std_n) &&
           said->adapting == 0 && said->fault == TROCAR_FAULT_NONE;
}

static void pointers(void)
{
    const trocar_compensator_options options = plain();
    trocar_compensator *observer = made(), *other = observer;
    trocar_estimate said;
    trocar_drift drift;

    REFUSED(NULL_POINTER, trocar_compensator_new(NULL, &options, &other, NULL, 0));
    CHECK(other == NULL);
    REFUSED(NULL_POINTER, trocar_compensator_new(model, &options, NULL, NULL, 0));
    REFUSED(MISALIGNED, trocar_compensator_new(ODD(trocar_model), &options, &other, NULL, 0));
    REFUSED(MISALIGNED, trocar_compensator_new(model, ODD(trocar_compensator_options), &other, NULL, 0));
    REFUSED(MISALIGNED, trocar_compensator_new(model, &options, ODD(trocar_compensator *), NULL, 0));
    REFUSED(NOT_A_MODEL, trocar_compensator_new((trocar_model *)(void *)observer, &options, &other, NULL, 0));
    REFUSED(NULL_POINTER, trocar_compensator_options_init(NULL, sizeof options));
    REFUSED(MISALIGNED, trocar_compensator_options_init(ODD(trocar_compensator_options), sizeof options));

    memset(&said, 0, sizeof said);
    REFUSED(NULL_POINTER, trocar_compensator_step(NULL, 0.1, 1.0, 1e-3, &said));
    CHECK(knows_nothing(&said));
    REFUSED(NULL_POINTER, trocar_compensator_step(observer, 0.1, 1.0, 1e-3, NULL));
    REFUSED(MISALIGNED, trocar_compensator_step(observer, 0.1, 1.0, 1e-3, ODD(trocar_estimate)));
    REFUSED(MISALIGNED, trocar_compensator_step(ODD(trocar_compensator), 0.1, 1.0, 1e-3, &said));
    REFUSED(NOT_A_COMPENSATOR, trocar_compensator_step((trocar_compensator *)(void *)model, 0.1, 1.0, 1e-3, &said));
    CHECK(knows_nothing(&said));
    REFUSED(NULL_POINTER, trocar_compensator_drift(NULL, &drift));
    REFUSED(NULL_POINTER, trocar_compensator_drift(observer, NULL));
    REFUSED(MISALIGNED, trocar_compensator_drift(observer, ODD(trocar_drift)));
    REFUSED(NULL_POINTER, trocar_compensator_reset(NULL));
    REFUSED(NOT_A_COMPENSATOR, trocar_compensator_reset((trocar_compensator *)(void *)model));
    REFUSED(NOT_A_COMPENSATOR, trocar_compensator_free((trocar_compensator *)(void *)model));
    REFUSED(MISALIGNED, trocar_compensator_free(ODD(trocar_compensator)));
    REFUSED(OK, trocar_compensator_free(NULL));
    /* None of it was a sample, and none left the compensator taken. */
    REFUSED(OK, trocar_compensator_step(observer, NAN, 1.0, 1e-3, &said));
    CHECK(said.fault == TROCAR_FAULT_NO_POSITION && said.trocar_force_n == 0.0 && isnan(said.tissue_force_std_n));
    REFUSED(OK, trocar_compensator_free(observer));
}

/* One option wrong: the status, and a word of the message. */
static void refused(trocar_compensator_options options, trocar_status status, const char *word)
{
    char message[TROCAR_MESSAGE_SIZE] = "";
    trocar_compensator *observer = NULL;
    CHECK(trocar_compensator_new(model, &options, &observer, message, sizeof message) == status);
    CHECK(observer == NULL && strstr(message, word) != NULL);
    if (strstr(message, word) == NULL) {
        fprintf(stderr, "no \"%s\" in: %s\n", word, message);
    }
}

static void options(void)
{
    char message[TROCAR_MESSAGE_SIZE] = "";
    trocar_compensator *observer = NULL;
    trocar_compensator_options one, before;

    one = plain(), one.struct_size = 0, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "struct_size must be");
    one = plain(), one.struct_size += 8, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "struct_size must be");
    one = plain(), one.offset_n = INFINITY, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "offset_n must be a finite");
    one = plain(), one.moving_mass_kg = -1.0, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "moving_mass_kg must be 0");
    one = plain(), one.gravity_m_s2 = NAN, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "gravity_m_s2 must be");
    one = plain(), one.sensor_limit_n = 0.0, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "sensor_limit_n must be above 0");
    one = plain(), one.force_error_n = -0.1, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "force_error_n must be");
    one = plain(), one.adaptation = 2, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "adaptation must be 0 or 1");
    one = plain(), one.flip_force = 2, refused(one, TROCAR_STATUS_OUT_OF_RANGE, "flip_force must be -1, 0 or 1");
    one = plain(), one.force_error_n = NAN, refused(one, TROCAR_STATUS_UNSUPPORTED, "set force_error_n");
    REFUSED(UNSUPPORTED, trocar_compensator_new(model, NULL, &observer, message, sizeof message));
    CHECK(observer == NULL && strstr(message, "force_error") != NULL);

    before = one = plain();
    REFUSED(OUT_OF_RANGE, trocar_compensator_options_init(&one, sizeof one - 8));
    REFUSED(OUT_OF_RANGE, trocar_compensator_options_init(&one, sizeof one + 8));
    CHECK(one.force_error_n == before.force_error_n && one.struct_size == sizeof one);
}

static trocar_fault fault_of(trocar_compensator *observer, double position_m, double force_n, double duration_s)
{
    trocar_estimate said;
    REFUSED(OK, trocar_compensator_step(observer, position_m, force_n, duration_s, &said));
    CHECK(isfinite(said.trocar_force_n));
    if (said.fault == TROCAR_FAULT_NO_READING || said.fault == TROCAR_FAULT_NO_POSITION ||
        said.fault == TROCAR_FAULT_SATURATED || said.fault == TROCAR_FAULT_FROZEN) {
        CHECK(isnan(said.tissue_force_n));
    }
    return said.fault;
}

static void sensors(void)
{
    trocar_compensator_options limited = plain();
    trocar_compensator *observer = NULL;
    trocar_estimate said, last;
    trocar_drift drift;
    int k;

    limited.sensor_limit_n = 15.0;
    REFUSED(OK, trocar_compensator_new(model, &limited, &observer, NULL, 0));
    CHECK(fault_of(observer, 0.1, 0.1, 0.0) == TROCAR_FAULT_NONE);
    CHECK(fault_of(observer, 0.1001, NAN, 1e-3) == TROCAR_FAULT_NO_READING);
    CHECK(fault_of(observer, 0.1002, -INFINITY, 1e-3) == TROCAR_FAULT_NO_READING);
    CHECK(fault_of(observer, NAN, 0.1, 1e-3) == TROCAR_FAULT_NO_POSITION);
    CHECK(fault_of(observer, INFINITY, NAN, NAN) == TROCAR_FAULT_NO_POSITION);
    REFUSED(OK, trocar_compensator_step(observer, 0.1003, 0.2, 1e-3, &last));
    CHECK(last.fault == TROCAR_FAULT_NONE && isfinite(last.tissue_force_n));
    REFUSED(OK, trocar_compensator_step(observer, 0.1003, 0.2, 0.0, &said));
    CHECK(said.fault == TROCAR_FAULT_NO_DURATION && said.trocar_force_n == last.trocar_force_n);
    CHECK(fault_of(observer, 0.1004, 0.2, -1e-3) == TROCAR_FAULT_NO_DURATION);
    CHECK(fault_of(observer, 0.1004, 0.2, NAN) == TROCAR_FAULT_NO_DURATION);
    CHECK(fault_of(observer, 0.1004, 0.2, INFINITY) == TROCAR_FAULT_NO_DURATION);
    CHECK(fault_of(observer, 0.1004, -15.0, 1e-3) == TROCAR_FAULT_SATURATED);
    CHECK(fault_of(observer, 0.2, 0.2, 1e-3) == TROCAR_FAULT_JUMP);
    CHECK(fault_of(observer, 0.2001, 0.2, 0.5) == TROCAR_FAULT_GAP);
    for (k = 0; k < 9; k++) {
        CHECK(strcmp(trocar_fault_message(k), "unknown fault") != 0);
    }
    CHECK(strcmp(trocar_fault_message(9), "unknown fault") == 0 && strcmp(trocar_fault_message(-1), "unknown fault") == 0);

    REFUSED(OK, trocar_compensator_drift(observer, &drift));
    CHECK(drift.level == 1.0 && drift.viscosity == 1.0 && drift.level_std > 0.0 && drift.viscosity_std > 0.0);
    REFUSED(OK, trocar_compensator_reset(observer));
    CHECK(fault_of(observer, 0.7, 0.1, -3.0) == TROCAR_FAULT_NONE);
    REFUSED(OK, trocar_compensator_free(observer));
}

/* Any numbers: a step ends, with a finite force on the trocar where it had one. */
static void anything(void)
{
    trocar_compensator *observer = made();
    unsigned long seed = 1;
    double numbers[3];
    int k, n;

    for (k = 0; k < 30000; k++) {
        for (n = 0; n < 3; n++) {
            seed = (seed * 1103515245UL + 12345UL) & 0x7fffffffUL;
            numbers[n] = (double)(seed >> 8) / 8388608.0 * (n == 2 ? 2e-3 : 0.1);
            if ((seed >> 5) % 500 == 0) {
                numbers[n] = ldexp((double)(seed >> 8) - 4e6, (int)(seed % 2000) - 1000);
            }
        }
        fault_of(observer, k % 2 == 0 ? 1e-3 * numbers[0] + 0.1 : 0.1 + 1e-3 * (k % 40), 10.0 * numbers[1], numbers[2]);
    }
    REFUSED(OK, trocar_compensator_free(observer));
}

/* A mistake of the caller: each call is done or refused as busy, and its results are complete. */
static void *shared(void *observer)
{
    trocar_estimate said;
    trocar_drift drift;
    int k;

    for (k = 0; k < 20000; k++) {
        const trocar_status status = trocar_compensator_step(observer, 0.1 + 1e-5 * (k % 900), 1.0, 1e-3, &said);
        const trocar_status read = trocar_compensator_drift(observer, &drift);
        const int busy = status == TROCAR_STATUS_STATE_BUSY;
        if ((status != TROCAR_STATUS_OK && !busy) || (busy && !knows_nothing(&said)) || !isfinite(said.trocar_force_n) ||
            (read != TROCAR_STATUS_OK && read != TROCAR_STATUS_STATE_BUSY)) {
            return NULL;
        }
    }
    return observer;
}

static void threads(void)
{
    trocar_compensator *observer = made();
    trocar_estimate said;
    pthread_t both[2];
    void *done;
    int k;

    for (k = 0; k < 2; k++) {
        pthread_create(&both[k], NULL, shared, observer);
    }
    for (k = 0; k < 2; k++) {
        pthread_join(both[k], &done);
        CHECK(done != NULL);
    }
    REFUSED(OK, trocar_compensator_step(observer, 0.1, 1.0, 1e-3, &said));
    REFUSED(OK, trocar_compensator_free(observer));
}

int main(int argc, char **argv)
{
    CHECK(argc == 2 && trocar_model_load(argv[1], &model, NULL, 0) == TROCAR_STATUS_OK);
    pointers();
    options();
    sensors();
    anything();
    threads();
    REFUSED(OK, trocar_model_free(model));
    return failed;
}
