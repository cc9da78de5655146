//@state
    double held_force_n; /* without the viscous part */
    double seal_force_n; /* of the seal alone */
//@code
static void trocar_rest_with(trocar_state *state, double force)
{
    state->held_force_n = trocar_held(force, trocar_sliding.static_force_n);
    state->seal_force_n = state->held_force_n;
}

/* EMS (11); at rest the force of the last motion without its viscous part. */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    const double s = trocar_sign(velocity);
    double held = state->held_force_n, force = held;
    (void)displacement;
    (void)duration;
    if (s != 0.0) {
        /* The last bit of g may lie beyond the bound. */
        held = s * trocar_least(trocar_level(&trocar_sliding, velocity), trocar_sliding.static_force_n);
        force = held + trocar_sliding.viscous_damping_n_s_m * velocity;
    }
    if (fabs(force) <= trocar_greatest) {
        state->held_force_n = held;
        state->seal_force_n = force;
    }
}

