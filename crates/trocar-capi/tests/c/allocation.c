/*
 * Nothing but loading, parsing, tuning and freeing a model, and making and freeing a compensator, allocates or frees. Linked with the static library and
 * -Wl,--wrap for each function below, so that every call of the library is counted.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <trocar.h>

static unsigned long calls;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
int __real_posix_memalign(void **place, size_t alignment, size_t size);
void __real_free(void *old);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *old, size_t size);
int __wrap_posix_memalign(void **place, size_t alignment, size_t size);
void __wrap_free(void *old);

void *__wrap_malloc(size_t size)
{
    calls++;
    return __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size)
{
    calls++;
    return __real_calloc(count, size);
}

void *__wrap_realloc(void *old, size_t size)
{
    calls++;
    return __real_realloc(old, size);
}

int __wrap_posix_memalign(void **place, size_t alignment, size_t size)
{
    calls++;
    return __real_posix_memalign(place, alignment, size);
}

void __wrap_free(void *old)
{
    calls++;
    __real_free(old);
}

static unsigned long run(const trocar_model *model)
{
    double saved[TROCAR_STATE_NUMBERS], time_s[100], position_m[100], force_n;
    char message[64];
    trocar_tunable tunable;
    trocar_state state;
    int32_t mode;
    size_t count;
    int k;
    const unsigned long before = calls;

    trocar_state_init(model, &state, 0.1);
    for (k = 0; k < 5000; k++) {
        trocar_step(model, &state, (k / 300) % 2 == 0 ? 4e-5 : -4e-5, 1e-3, &force_n);
        trocar_step_to(model, &state, 0.1 + 1e-5 * (k % 700), 1e-3, &force_n);
        trocar_step_velocity(model, &state, 0.01, 1e-3, &force_n);
        trocar_step(model, &state, 0.0, 0.0, &force_n);
        trocar_state_force(&state, &force_n);
        trocar_state_position(&state, &force_n);
        trocar_state_deflection(model, &state, &force_n);
        trocar_state_mode(model, &state, &mode);
    }
    for (k = 0; k < 100; k++) {
        time_s[k] = 1e-3 * (k + 1);
        position_m[k] = 0.1 + 1e-5 * k;
    }
    trocar_simulate(model, &state, 0.0, 100, time_s, position_m, position_m, &count);
    trocar_state_save(&state, saved, TROCAR_STATE_NUMBERS);
    trocar_state_restore(model, &state, saved, TROCAR_STATE_NUMBERS, message, sizeof message);
    trocar_state_init_at_force(model, &state, 0.1, 1.0);
    trocar_state_init_at_deflection(model, &state, 0.1, 1e-3);
    trocar_model_tunable_count(model, &count);
    trocar_model_tunable(model, 0, &tunable);
    trocar_model_kind(model);
    trocar_status_message(3);
    trocar_version();
    return calls - before;
}

/* There and back with tremor and faults: adaptation, a change of level, resets. */
static unsigned long observe(trocar_compensator *observer)
{
    trocar_estimate said;
    trocar_drift drift;
    const unsigned long before = calls;
    int k;

    for (k = 0; k < 20000; k++) {
        const double along = fabs(fmod(5e-5 * k, 0.1) - 0.05);
        const double turn = fmod(5e-5 * k, 0.1) < 0.05 ? -1.0 : 1.0;
        const double force_n = k % 997 == 0 ? NAN : turn * (k < 10000 ? 3.2 : 1.0) + 1e-3 * (k % 7);
        trocar_compensator_step(observer, k % 1999 == 7 ? NAN : along, force_n, k % 1499 == 0 ? 0.0 : 1e-3, &said);
        trocar_compensator_drift(observer, &drift);
    }
    trocar_compensator_reset(observer);
    trocar_compensator_step(observer, 0.1, 0.0, 0.0, &said);
    trocar_compensator_step(observer, 0.9, 0.0, 1e-3, &said);
    trocar_compensator_step(observer, 0.9, 0.0, 1.0, &said);
    trocar_compensator_step(NULL, 0.9, 0.0, 1.0, &said);
    trocar_fault_message(3);
    return calls - before;
}

static trocar_compensator *observer_of(const trocar_model *model)
{
    trocar_compensator_options options;
    trocar_compensator *observer = NULL;
    trocar_compensator_options_init(&options, sizeof options);
    options.force_error_n = 0.05;
    options.moving_mass_kg = 0.04;
    trocar_compensator_new(model, &options, &observer, NULL, 0);
    return observer;
}

int main(int argc, char **argv)
{
    int k;
    for (k = 1; k < argc; k++) {
        char message[TROCAR_MESSAGE_SIZE] = "";
        trocar_model *model = NULL;
        trocar_compensator *observer;
        unsigned long counted;
        calls = 0;
        if (trocar_model_load(argv[k], &model, message, sizeof message) != TROCAR_STATUS_OK) {
            fprintf(stderr, "%s\n", message);
            return 2;
        }
        if (calls == 0) {
            fprintf(stderr, "nothing is counted\n");
            return 2;
        }
        counted = run(model);
        observer = observer_of(model);
        if (observer == NULL) {
            fprintf(stderr, "no observer\n");
            return 2;
        }
        counted += observe(observer);
        trocar_compensator_free(observer);
        trocar_model_free(model);
        if (counted != 0) {
            fprintf(stderr, "%s: %lu calls of the allocator\n", argv[k], counted);
            return 1;
        }
    }
    return 0;
}
