//@state
    double element_force_n[@ELEMENTS@]; /* f_i, |f_i| <= F_i */
    double seal_force_n;                 /* of the seal alone */
//@code
static void trocar_rest_with(trocar_state *state, double force)
{
    const double held = trocar_held(force, trocar_limit_n);
    int i;
    state->seal_force_n = -0.0;
    for (i = 0; i < trocar_elements; ++i) {
        state->element_force_n[i] = held / trocar_limit_n * trocar_limit_force_n[i];
        state->seal_force_n += state->element_force_n[i];
    }
}

/* Springs with a dry slider each, EMS (1) to (3). */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    const double viscous = trocar_viscous_damping_n_s_m * velocity;
    double elastic = 0.0;
    int i;
    (void)duration;
    if (fabs(viscous) + trocar_limit_n > trocar_greatest) {
        return;
    }
    for (i = 0; i < trocar_elements; ++i) {
        const double loaded = state->element_force_n[i] + trocar_stiffness_n_m[i] * displacement;
        state->element_force_n[i] = trocar_within(loaded, trocar_limit_force_n[i]); /* EMS (1), (2) */
        elastic += state->element_force_n[i];
    }
    state->seal_force_n = elastic + viscous; /* EMS (3) */
}

