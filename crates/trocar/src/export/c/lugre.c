//@state
    double deflection_m; /* z of the bristles */
    double seal_force_n; /* of the seal alone */
//@code
static void trocar_rest_with(trocar_state *state, double force)
{
    state->deflection_m = trocar_held(force, trocar_sliding.static_force_n) / trocar_stiffness_n_m;
    state->seal_force_n = trocar_stiffness_n_m * state->deflection_m;
}

/* sigma_1(v), N s/m. */
static double trocar_micro_damping(double velocity)
{
//@if fading
    const double ratio = velocity * trocar_inverse_damping_velocity_s_m;
    return trocar_micro_damping_n_s_m * trocar_decay(ratio * ratio);
//@else
    (void)velocity;
    return trocar_micro_damping_n_s_m;
//@end
}

/* dz/dt = v - sigma_0*|v|*z/g(|v|); F = sigma_0*z + sigma_1(v)*dz/dt + sigma_2*v. */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    const double z = state->deflection_m, s = trocar_sign(velocity);
    double deflection = z, force = trocar_stiffness_n_m * z;
    (void)duration;
    if (s != 0.0) {
        const double level = trocar_level(&trocar_sliding, velocity);
        const double settled = s * level / trocar_stiffness_n_m;
        const double yielding = trocar_stiffness_n_m / level;
        const double left = trocar_decay(fabs(displacement) * yielding);
        const double rate = velocity * (1.0 - s * z * yielding) * left;
        const double viscous = trocar_sliding.viscous_damping_n_s_m * velocity;
        /* The last bit of a sum may lie beyond the bound. */
        deflection = trocar_within(settled + (z - settled) * left, trocar_greatest_deflection_m);
        force = trocar_stiffness_n_m * deflection + trocar_micro_damping(velocity) * rate + viscous;
    }
    if (fabs(force) <= trocar_greatest && fabs(deflection) <= trocar_greatest) {
        state->deflection_m = deflection;
        state->seal_force_n = force;
    }
}

