/*
 * A stroke at 20 mm/s while the instrument turns once a second, printed as force and torque a line, with an observer that
 * finds both; and what is refused: turning of a model of the axis, an angle that is not finite.
 *
 *     turning MODEL_WITH_ROTATION MODEL
 */
#include <math.h>
#include <stdio.h>

#include <trocar.h>

#define CHECK(condition) \
    do { \
        if (!(condition)) { \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition); \
            return 1; \
        } \
    } while (0)

static trocar_compensator *observer_of(const trocar_model *model)
{
    trocar_compensator_options options;
    trocar_compensator *observer = NULL;
    trocar_compensator_options_init(&options, sizeof options);
    options.force_error_n = 0.05;
    options.adaptation = 0;
    trocar_compensator_new(model, &options, &observer, NULL, 0);
    return observer;
}

int main(int count, char **arguments)
{
    char message[TROCAR_MESSAGE_SIZE];
    trocar_model *turning = NULL, *plain = NULL;
    trocar_state state, before;
    trocar_compensator *observer, *along;
    trocar_estimate said;
    double force, torque, again, felt;
    int k;

    CHECK(count == 3);
    CHECK(trocar_model_load(arguments[1], &turning, message, sizeof message) == TROCAR_STATUS_OK);
    CHECK(trocar_model_load(arguments[2], &plain, message, sizeof message) == TROCAR_STATUS_OK);
    CHECK(trocar_state_init(turning, &state, 0.0) == TROCAR_STATUS_OK);
    observer = observer_of(turning);
    along = observer_of(plain);
    CHECK(trocar_compensator_turn(observer, 0.0, 0.0, 0.0, 0.0, &said, &felt) == TROCAR_STATUS_OK);
    for (k = 1; k <= 1000; k++) {
        CHECK(trocar_turn_to(turning, &state, 2e-5 * k, 6.25e-3 * k, 1e-3, &force) == TROCAR_STATUS_OK);
        CHECK(trocar_state_torque(turning, &state, &torque) == TROCAR_STATUS_OK);
        printf("%.17g %.17g\n", force, torque);
        CHECK(trocar_compensator_turn(observer, 2e-5 * k, 6.25e-3 * k, force + 0.5, 1e-3, &said, &felt) == TROCAR_STATUS_OK);
    }
    /* It began at rest with the first reading, which sliding has made forget. */
    CHECK(fabs(said.tissue_force_n - 0.5) < 1e-2 && fabs(felt - torque) < 1e-3 * torque);
    CHECK(trocar_compensator_turn(observer, 0.02, NAN, force, 1e-3, &said, &felt) == TROCAR_STATUS_OK);
    CHECK(said.fault == TROCAR_FAULT_NO_POSITION && fabs(felt - torque) < 1e-3 * torque);
    CHECK(trocar_compensator_turn(along, 0.02, 1.0, force, 1e-3, &said, &felt) == TROCAR_STATUS_UNSUPPORTED);
    CHECK(isnan(said.tissue_force_n) && felt == 0.0);
    CHECK(trocar_compensator_turn(observer, 0.02, 1.0, force, 1e-3, &said, NULL) == TROCAR_STATUS_NULL_POINTER);
    CHECK(trocar_compensator_free(observer) == TROCAR_STATUS_OK && trocar_compensator_free(along) == TROCAR_STATUS_OK);
    before = state;
    CHECK(trocar_turn_to(turning, &state, 0.02, NAN, 1e-3, &again) == TROCAR_STATUS_NOT_FINITE);
    CHECK(again == force);
    CHECK(trocar_turn_to(turning, &state, 0.02, 7.0, 0.0, &again) == TROCAR_STATUS_DURATION_NOT_POSITIVE);
    CHECK(trocar_state_torque(turning, &state, &again) == TROCAR_STATUS_OK && again == torque);
    CHECK(state.words[3] == before.words[3]);
    CHECK(trocar_state_init(plain, &state, 0.0) == TROCAR_STATUS_OK);
    CHECK(trocar_turn_to(plain, &state, 0.02, 1.0, 1e-3, &again) == TROCAR_STATUS_UNSUPPORTED);
    CHECK(trocar_state_torque(plain, &state, &torque) == TROCAR_STATUS_OK && torque == 0.0);
    CHECK(trocar_model_free(turning) == TROCAR_STATUS_OK);
    CHECK(trocar_model_free(plain) == TROCAR_STATUS_OK);
    return 0;
}
