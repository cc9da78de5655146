/*
 * Runs a model along a motion and prints one force (N) a row. Usage: drive MODEL.json MOTION.csv [steps|array]
 *
 * The motion has a header and the columns time_s,position_m. The first row is where the seal rests; every other is
 * stepped to; a row with the time and position of the one before repeats the force. "array" does the same in one call.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <trocar.h>

struct motion {
    size_t count;
    double *time_s;
    double *position_m;
};

static int read_motion(const char *path, struct motion *motion)
{
    char line[256];
    size_t room = 0;
    FILE *file = fopen(path, "r");

    if (file == NULL) {
        fprintf(stderr, "%s: %s\n", path, strerror(errno));
        return 0;
    }
    if (fgets(line, sizeof line, file) == NULL || strncmp(line, "time_s,position_m", 17) != 0) {
        fprintf(stderr, "%s: the header must be time_s,position_m\n", path);
        fclose(file);
        return 0;
    }
    while (fgets(line, sizeof line, file) != NULL) {
        char *end = line;
        char *position;
        if (motion->count == room) {
            room = room > 0 ? 2 * room : 1024;
            motion->time_s = realloc(motion->time_s, room * sizeof(double));
            motion->position_m = realloc(motion->position_m, room * sizeof(double));
            if (motion->time_s == NULL || motion->position_m == NULL) {
                abort();
            }
        }
        motion->time_s[motion->count] = strtod(line, &end);
        position = *end == ',' ? end + 1 : end;
        motion->position_m[motion->count] = strtod(position, &end);
        if (position == line || end == position) {
            fprintf(stderr, "%s line %lu: two numbers expected\n", path, (unsigned long)motion->count + 2);
            fclose(file);
            return 0;
        }
        motion->count++;
    }
    fclose(file);
    return motion->count > 0;
}

/* Force at every row but the first, step by step. */
static trocar_status run_steps(const trocar_model *model, trocar_state *seal, const struct motion *motion, double *force_n)
{
    size_t row;

    for (row = 1; row < motion->count; row++) {
        const double duration_s = motion->time_s[row] - motion->time_s[row - 1];
        const trocar_status status =
            trocar_step_to(model, seal, motion->position_m[row], duration_s, &force_n[row]);
        const int repeated = duration_s == 0.0 && motion->position_m[row] == motion->position_m[row - 1];
        if (status != TROCAR_STATUS_OK && !repeated) {
            fprintf(stderr, "row %lu: ", (unsigned long)row + 1);
            return status;
        }
    }
    return TROCAR_STATUS_OK;
}

int main(int argc, char **argv)
{
    char message[TROCAR_MESSAGE_SIZE] = "";
    struct motion motion = {0, NULL, NULL};
    trocar_model *model = NULL;
    trocar_state seal;
    trocar_status status;
    double *force_n;
    size_t row;

    if (argc < 3) {
        fprintf(stderr, "usage: drive MODEL.json MOTION.csv [steps|array]\n");
        return 2;
    }
    status = trocar_model_load(argv[1], &model, message, sizeof message);
    if (status != TROCAR_STATUS_OK) {
        fprintf(stderr, "%s\n", message);
        return 1;
    }
    if (!read_motion(argv[2], &motion)) {
        return 1;
    }
    force_n = malloc(motion.count * sizeof(double));
    if (force_n == NULL) {
        abort();
    }
    status = trocar_state_init(model, &seal, motion.position_m[0]);
    if (status == TROCAR_STATUS_OK) {
        status = trocar_state_force(&seal, &force_n[0]);
    }
    if (status == TROCAR_STATUS_OK && argc > 3 && strcmp(argv[3], "array") == 0) {
        status = trocar_simulate(model, &seal, motion.time_s[0], motion.count, motion.time_s, motion.position_m,
                                 force_n, NULL);
    } else if (status == TROCAR_STATUS_OK) {
        status = run_steps(model, &seal, &motion, force_n);
    }
    if (status != TROCAR_STATUS_OK) {
        fprintf(stderr, "%s\n", trocar_status_message(status));
        return 1;
    }
    for (row = 0; row < motion.count; row++) {
        printf("%.17g\n", force_n[row]);
    }
    trocar_model_free(model);
    free(motion.time_s);
    free(motion.position_m);
    free(force_n);
    return 0;
}
