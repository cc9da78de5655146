//@if profile
/* A position profile at position x: straight between the knots; outside, it fades to `none`. */
static double trocar_at_position(const double *values, double none, double x)
{
    const double intervals = (double)(trocar_knots - 1);
    double along = (x - trocar_from_m) / (trocar_to_m - trocar_from_m) * intervals;
    const double outside = x < trocar_from_m ? trocar_from_m - x : x > trocar_to_m ? x - trocar_to_m : 0.0;
    const double faded = outside / (trocar_fade * (trocar_to_m - trocar_from_m));
    double inside;
    int knot;
    if (faded >= 1.0) {
        return none;
    }
    along = along > 0.0 ? along : 0.0;
    along = along < intervals ? along : intervals;
    knot = (int)along;
    knot = knot < trocar_knots - 2 ? knot : trocar_knots - 2;
    inside = values[knot] + (along - (double)knot) * (values[knot + 1] - values[knot]);
    return faded > 0.0 ? inside + faded * (none - inside) : inside;
}

//@end
static double trocar_seal_force(const trocar_state *state)
{
//@if ems
    double force = -0.0;
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        force += state->element[k].force_n;
    }
    return force;
//@else
    return state->seal_force_n;
//@end
}

/* The force at position x where the seal is as it is: F = F_0(x) + gain(x)*F_seal. */
static double trocar_force_at(const trocar_state *state, double x)
{
    const double force = trocar_seal_force(state);
//@if profile
    return trocar_at_position(trocar_offset_n, 0.0, x) + trocar_at_position(trocar_gain, 1.0, x) * force;
//@else
    (void)x;
    return force;
//@end
}

//@if turning
//@else
//@if ems
static void trocar_step_elements(const trocar_element *elements, trocar_state *state, double velocity, double duration)
{
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        trocar_step_element(&elements[k], &state->element[k], velocity, duration);
    }
}

//@end
//@end
//@if turning
/* Turns by `arc` (m) at the surface of the shaft at the velocities `motion`, and stores the torque at `position`. */
static void trocar_turn_elements(trocar_state *state, trocar_pair motion, double arc, double position, double duration)
{
//@if profile
    const double gain = trocar_at_position(trocar_gain, 1.0, position);
//@else
    const double gain = 1.0;
//@end
    double force = 0.0;
    int k;
//@if profile
//@else
    (void)position;
//@end
    for (k = 0; k < trocar_elements; ++k) {
        const trocar_element *e = &trocar_element_constants[k];
        trocar_element_state *own = &state->element[k];
        if (arc == 0.0 && own->around_deflection_m == 0.0 && own->around_slip_velocity_m_s == 0.0) {
            trocar_step_element(e, own, motion.x, duration);
        } else {
            trocar_turn_element(e, own, motion, duration);
            force += e->around_stiffness_n_m * own->around_deflection_m;
        }
    }
    state->torque_n_m = trocar_shaft_radius_m * gain * force;
}

static double trocar_advance_to(trocar_state *state, double position, double displacement, double angle,
                                double duration)
{
    if (duration > 0.0 && duration <= trocar_greatest && fabs(position) <= trocar_greatest) {
        const double arc = trocar_shaft_radius_m * (angle - state->angle_rad);
        trocar_pair motion;
        motion.x = displacement / duration;
        motion.t = arc / duration;
        if (fabs(motion.x) <= trocar_greatest && fabs(motion.t) <= trocar_greatest) {
            trocar_turn_elements(state, motion, arc, position, duration);
            state->angle_rad = angle;
            state->position_m = position;
            state->force_n = trocar_force_at(state, position);
        }
    }
    return state->force_n;
}
//@else
static double trocar_advance_to(trocar_state *state, double position, double displacement, double duration)
{
    if (duration > 0.0 && duration <= trocar_greatest && fabs(position) <= trocar_greatest) {
        const double velocity = displacement / duration;
        if (fabs(velocity) <= trocar_greatest) {
//@if ems
            trocar_step_elements(trocar_element_constants, state, velocity, duration);
//@else
            trocar_step_seal(state, velocity, displacement, duration);
//@end
            state->position_m = position;
            state->force_n = trocar_force_at(state, position);
        }
    }
    return state->force_n;
}
//@end

@LINKAGE@void trocar_rest(trocar_state *state, double position_m)
{
    state->position_m = fabs(position_m) <= trocar_greatest ? position_m : 0.0;
//@if ems
    trocar_rest_elements(state);
//@else
    trocar_rest_with(state, 0.0);
//@end
    state->force_n = trocar_force_at(state, state->position_m);
//@if turning
    state->angle_rad = 0.0;
    state->torque_n_m = 0.0;
//@end
}

@LINKAGE@double trocar_step(trocar_state *state, double displacement_m, double duration_s)
{
    return trocar_advance_to(state, state->position_m + displacement_m, displacement_m, @ANGLE@duration_s);
}

@LINKAGE@double trocar_step_to(trocar_state *state, double position_m, double duration_s)
{
    return trocar_advance_to(state, position_m, position_m - state->position_m, @ANGLE@duration_s);
}
//@if turning

@LINKAGE@double trocar_turn_to(trocar_state *state, double position_m, double angle_rad, double duration_s)
{
    return trocar_advance_to(state, position_m, position_m - state->position_m, angle_rad, duration_s);
}
//@end
