/*
 * Runs the observer of the tissue force along readings and prints a row for each:
 * trocar_force_n,tissue_force_n,tissue_force_std_n,adapting,fault
 *
 * Usage: compensate MODEL.json READINGS.csv [FORCE_ERROR_N [MOVING_MASS_KG [SENSOR_LIMIT_N]]]
 *
 * The readings have a header and the columns time_s,position_m,force_n; "nan" is a missing one.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <trocar.h>

static int run(trocar_compensator *observer, FILE *readings)
{
    char line[256];
    double before_s = 0.0;
    unsigned long row = 0;

    while (fgets(line, sizeof line, readings) != NULL) {
        double time_s, position_m, force_n;
        trocar_estimate now;
        trocar_status status;
        if (row++ == 0) {
            continue;
        }
        if (sscanf(line, "%lf,%lf,%lf", &time_s, &position_m, &force_n) != 3) {
            fprintf(stderr, "line %lu: three numbers expected\n", row);
            return 0;
        }
        status = trocar_compensator_step(observer, position_m, force_n, row == 2 ? 0.0 : time_s - before_s, &now);
        if (status != TROCAR_STATUS_OK) {
            fprintf(stderr, "line %lu: %s\n", row, trocar_status_message(status));
            return 0;
        }
        before_s = time_s;
        printf("%.17g,%.17g,%.17g,%d,%d\n", now.trocar_force_n, now.tissue_force_n, now.tissue_force_std_n,
               (int)now.adapting, (int)now.fault);
    }
    return 1;
}

int main(int argc, char **argv)
{
    char message[TROCAR_MESSAGE_SIZE] = "";
    trocar_compensator_options options;
    trocar_compensator *observer = NULL;
    trocar_model *model = NULL;
    FILE *readings;
    int done;

    if (argc < 3) {
        fprintf(stderr, "usage: compensate MODEL.json READINGS.csv [FORCE_ERROR_N [MOVING_MASS_KG [SENSOR_LIMIT_N]]]\n");
        return 2;
    }
    trocar_compensator_options_init(&options, sizeof options);
    options.force_error_n = argc > 3 ? atof(argv[3]) : options.force_error_n;
    options.moving_mass_kg = argc > 4 ? atof(argv[4]) : options.moving_mass_kg;
    options.sensor_limit_n = argc > 5 ? atof(argv[5]) : options.sensor_limit_n;
    if (trocar_model_load(argv[1], &model, message, sizeof message) != TROCAR_STATUS_OK ||
        trocar_compensator_new(model, &options, &observer, message, sizeof message) != TROCAR_STATUS_OK) {
        fprintf(stderr, "%s\n", message);
        trocar_model_free(model);
        return 1;
    }
    trocar_model_free(model); /* the observer keeps what it needs */
    readings = fopen(argv[2], "r");
    if (readings == NULL) {
        fprintf(stderr, "%s: %s\n", argv[2], strerror(errno));
        trocar_compensator_free(observer);
        return 1;
    }
    done = run(observer, readings);
    fclose(readings);
    trocar_compensator_free(observer);
    return done ? 0 : 1;
}
