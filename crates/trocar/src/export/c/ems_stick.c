/* Deformation without any slip. */
static void trocar_stick(trocar_element_state *state, double deflection, double yield_force, double force)
{
    state->deflection_m = deflection;
    state->yield_force_n = yield_force;
    state->force_n = force;
    state->slip_velocity_m_s = 0.0;
//@if creep
    state->contact_slope_n_s_m = 0.0;
//@end
//@if lag
    state->rise = 1.0;
//@end
    state->sliding = 0;
}

//@if confined
/* Slides for at most `time` beyond an end, from excess = |z| - c; returns the time left. EMS (20) on a straight spring:
 * the excess relaxes towards beta*v_d/K with the rate K/beta. */
static double trocar_slide_on_end(const trocar_element *e, trocar_element_state *state, int side, double excess,
                                  double velocity, double time)
{
    const trocar_contact *c = &e->contact[side];
    const double s = side ? 1.0 : -1.0;
    const double settled = c->lag_s * s * velocity;
    double end = settled + (excess - settled) * trocar_decay(c->rate_1_s * time);
    double slip, left = 0.0;
    if (end < 0.0 || (end <= 0.0 && s * velocity < 0.0)) {
        left = time - (settled < 0.0 ? c->lag_s * log1p(-excess / settled) : 0.0);
    }
    end = end > 0.0 ? end : 0.0;
    slip = c->lag_s > 0.0 ? s * c->rate_1_s * end : velocity;
    trocar_stick(state, s * (e->half_width_m + end), 0.0, s * (c->end_force_n + c->end_stiffness_n_m * end));
    state->slip_velocity_m_s = slip;
    state->sliding = slip != 0.0;
    return left;
}

/* The exact solution at constant velocity where sliding only happens on the straight ends. */
static void trocar_advance_confined(const trocar_element *e, trocar_element_state *state, double velocity, double time)
{
    const double c = e->half_width_m;
    double z = state->deflection_m, q = state->yield_force_n;
    double target, force;
    if (z > c || z < -c) {
        const int side = z > c;
        time = trocar_slide_on_end(e, state, side, fabs(z) - c, velocity, time);
        if (time <= 0.0) {
            return;
        }
        z = side ? c : -c;
        q = 0.0;
    }
    target = z + velocity * time;
    if (target > c) {
        trocar_slide_on_end(e, state, 1, 0.0, velocity, (target - c) / velocity);
    } else if (target < -c) {
        trocar_slide_on_end(e, state, 0, 0.0, velocity, (target + c) / velocity);
    } else {
        force = trocar_reach(e, z, q, target, &q);
        trocar_stick(state, target, q, force);
    }
}

//@end
