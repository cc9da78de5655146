/* @TITLE@
 *
@ORIGIN@ *
 * Units: m, s, N. Position and displacement are positive on insertion; the force is that of the instrument on the seal,
 * the instrument feels its negative.
 *
 *     trocar_state state;
 *     trocar_rest(&state, position);                       once: a seal without force at that position
 *     force = trocar_step(&state, displacement, duration); every sample, from an encoder
 *     force = trocar_step_to(&state, position, duration);  or by the position itself
 *
 * The functions are in @STEM@.c. Not a medical device. */

#ifndef trocar_H
#define trocar_H

//@if compensator
#include <stdint.h>

//@end
#ifdef __cplusplus
extern "C" {
#endif

//@if ems
/* Everything that changes while one element runs. */
typedef struct {
    double deflection_m;      /* z of the seal */
    double yield_force_n;     /* q, force beyond the mid curve */
    double force_n;           /* of this element alone */
    double slip_velocity_m_s; /* v_sl, of the instrument against the seal, at the end of the last step */
//@if creep
    double contact_slope_n_s_m; /* of the friction over the slip speed */
//@end
//@if lag
    double rise; /* part of F_s - F_c that the contact has, 0 to 1 */
//@end
//@if arms
    double arm_force_n[2]; /* what relaxes with time */
//@end
//@if dwell
    double contact_age_s; /* how long the contact has rested, forgotten as it slips */
//@end
//@if turning
    double around_deflection_m;      /* around the shaft, at its surface */
    double around_slip_velocity_m_s;
//@end
    int sliding; /* 1: the instrument slides through the seal; 0: the seal deforms with it */
} trocar_element_state;

//@end
/* Everything that changes while the model runs. Fill it with trocar_rest; read it as you like, copy it as you like. */
typedef struct {
    double position_m; /* of the instrument */
    double force_n;    /* after the last step: that of the instrument on the seal */
//@if turning
    double angle_rad;  /* of the instrument; set it after trocar_rest where it does not begin at 0 */
    double torque_n_m; /* after the last step: that of the instrument on the seal, positive with the angle */
//@end
//@if ems
    trocar_element_state element[@ELEMENTS@];
//@end
//@state
} trocar_state;

/* An undeformed seal at rest on an instrument at position_m; one that is not finite counts as 0. */
@LINKAGE@void trocar_rest(trocar_state *state, double position_m);

/* Advances by displacement_m within duration_s at constant velocity; returns the force (N) at the end, that of the
 * instrument on the seal. A duration that is not positive, or a displacement, duration or velocity that is not finite,
 * leaves the state untouched and returns the last force. */
@LINKAGE@double trocar_step(trocar_state *state, double displacement_m, double duration_s);

/* Advances to position_m within duration_s; as trocar_step. */
@LINKAGE@double trocar_step_to(trocar_state *state, double position_m, double duration_s);
//@if turning

/* Advances to position_m and turns to angle_rad within duration_s, both at constant velocity; as trocar_step_to. The
 * other steps leave the angle as it is. The torque is then in the state. */
@LINKAGE@double trocar_turn_to(trocar_state *state, double position_m, double angle_rad, double duration_s);
//@end
