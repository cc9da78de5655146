/*
 * A stroke at 20 mm/s while the instrument turns once a second, printed as force and torque a line; and what is refused: turning of a model of the axis, an
 * angle that is not finite.
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

int main(int count, char **arguments)
{
    char message[TROCAR_MESSAGE_SIZE];
    trocar_model *turning = NULL, *plain = NULL;
    trocar_state state, before;
    double force, torque, again;
    int k;

    CHECK(count == 3);
    CHECK(trocar_model_load(arguments[1], &turning, message, sizeof message) == TROCAR_STATUS_OK);
    CHECK(trocar_model_load(arguments[2], &plain, message, sizeof message) == TROCAR_STATUS_OK);
    CHECK(trocar_state_init(turning, &state, 0.0) == TROCAR_STATUS_OK);
    for (k = 1; k <= 1000; k++) {
        CHECK(trocar_turn_to(turning, &state, 2e-5 * k, 6.25e-3 * k, 1e-3, &force) == TROCAR_STATUS_OK);
        CHECK(trocar_state_torque(turning, &state, &torque) == TROCAR_STATUS_OK);
        printf("%.17g %.17g\n", force, torque);
    }
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
