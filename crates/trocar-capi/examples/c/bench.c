/*
 * Time per step, in C. Usage: bench MODEL.json...
 *
 * 40 mm strokes with a tremor at 1 kHz; the fastest of several runs, of single steps and of whole arrays.
 */
#define _POSIX_C_SOURCE 199309L

#include <stdio.h>
#include <time.h>

#include <trocar.h>

enum { STEPS = 20000, RUNS = 15 };

static double time_s[STEPS];
static double position_m[STEPS];
static double force_n[STEPS];

static double now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

/* Strokes of 40 mm at 50 mm/s with a triangular tremor of 0.2 mm at 8 Hz. */
static void make_motion(void)
{
    int k;
    for (k = 0; k < STEPS; k++) {
        const int stroke = k % 1600;
        const int tremor = k % 125;
        time_s[k] = 1e-3 * (k + 1);
        position_m[k] = 0.1 + 50e-6 * (stroke < 800 ? stroke : 1600 - stroke);
        position_m[k] += 2e-4 * (tremor < 62 ? tremor / 62.0 : (125 - tremor) / 63.0);
    }
}

static void least(double *best, double value)
{
    *best = value < *best ? value : *best;
}

static int report(const char *path)
{
    char message[TROCAR_MESSAGE_SIZE] = "";
    trocar_model *model = NULL;
    trocar_state seal;
    double single = 1e300;
    double array = 1e300;
    double start;
    int run, k;

    if (trocar_model_load(path, &model, message, sizeof message) != TROCAR_STATUS_OK) {
        fprintf(stderr, "%s\n", message);
        return 1;
    }
    for (run = 0; run < RUNS; run++) {
        trocar_state_init(model, &seal, 0.1);
        start = now_ns();
        for (k = 0; k < STEPS; k++) {
            trocar_step_to(model, &seal, position_m[k], 1e-3, &force_n[k]);
        }
        least(&single, (now_ns() - start) / STEPS);
        trocar_state_init(model, &seal, 0.1);
        start = now_ns();
        trocar_simulate(model, &seal, 0.0, STEPS, time_s, position_m, force_n, NULL);
        least(&array, (now_ns() - start) / STEPS);
    }
    printf("%-14s step %6.1f ns   array %6.1f ns   %s\n", trocar_model_kind(model), single, array, path);
    trocar_model_free(model);
    return 0;
}

int main(int argc, char **argv)
{
    int failed = 0;
    int k;
    make_motion();
    for (k = 1; k < argc; k++) {
        failed |= report(argv[k]);
    }
    return failed;
}
