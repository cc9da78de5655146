/* One model under many threads with a state each, then one state under two threads. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include <trocar.h>

enum { THREADS = 8, STEPS = 20000 };

static trocar_model *model;
static double forces[THREADS][STEPS];
static trocar_state shared;

static double position_m(int k)
{
    return 0.1 + 0.02 * sin(3e-3 * k) + 2e-4 * sin(0.05 * k);
}

static void *own_state(void *place)
{
    double *force_n = place;
    trocar_state state;
    int k;
    if (trocar_state_init(model, &state, position_m(0)) != TROCAR_STATUS_OK) {
        return NULL;
    }
    for (k = 0; k < STEPS; k++) {
        if (trocar_step_to(model, &state, position_m(k + 1), 1e-3, &force_n[k]) != TROCAR_STATUS_OK) {
            return NULL;
        }
    }
    return place;
}

/* A mistake of the caller: each call is done or refused as busy, and reads stay finite. */
static void *shared_state(void *busy)
{
    unsigned long *refused = busy;
    double force_n;
    int k;
    for (k = 0; k < 20 * STEPS; k++) {
        const trocar_status status = trocar_step(model, &shared, k % 2 == 0 ? 1e-5 : -1e-5, 1e-3, &force_n);
        const trocar_status read = trocar_state_force(&shared, &force_n);
        *refused += status == TROCAR_STATUS_STATE_BUSY;
        if ((status != TROCAR_STATUS_OK && status != TROCAR_STATUS_STATE_BUSY) ||
            (read != TROCAR_STATUS_OK && read != TROCAR_STATUS_STATE_BUSY) || !isfinite(force_n)) {
            return NULL;
        }
    }
    return busy;
}

int main(int argc, char **argv)
{
    pthread_t threads[THREADS];
    unsigned long busy[2] = {0, 0};
    char message[TROCAR_MESSAGE_SIZE] = "";
    double force_n;
    void *done;
    int k;

    if (argc != 2 || trocar_model_load(argv[1], &model, message, sizeof message) != TROCAR_STATUS_OK) {
        fprintf(stderr, "usage: threads MODEL.json %s\n", message);
        return 2;
    }
    for (k = 0; k < THREADS; k++) {
        pthread_create(&threads[k], NULL, own_state, forces[k]);
    }
    for (k = 0; k < THREADS; k++) {
        pthread_join(threads[k], &done);
        if (done == NULL || memcmp(forces[k], forces[0], sizeof forces[0]) != 0) {
            fprintf(stderr, "thread %d has other forces\n", k);
            return 1;
        }
    }
    trocar_state_init(model, &shared, 0.1);
    for (k = 0; k < 2; k++) {
        pthread_create(&threads[k], NULL, shared_state, &busy[k]);
    }
    for (k = 0; k < 2; k++) {
        pthread_join(threads[k], &done);
        if (done == NULL) {
            fprintf(stderr, "a shared state was spoilt\n");
            return 1;
        }
    }
    if (trocar_step(model, &shared, 1e-5, 1e-3, &force_n) != TROCAR_STATUS_OK || !isfinite(force_n)) {
        fprintf(stderr, "a state stayed busy\n");
        return 1;
    }
    printf("%d threads, the same forces; one state for two: refused as busy %lu times\n", THREADS, busy[0] + busy[1]);
    return trocar_model_free(model) != TROCAR_STATUS_OK;
}
