//@state
    double hysteresis_force_n; /* f, without the viscous part, |f| <= F_c */
    double seal_force_n;       /* of the seal alone */
//@code
static void trocar_rest_with(trocar_state *state, double force)
{
    state->hysteresis_force_n = trocar_held(force, trocar_coulomb_force_n);
    state->seal_force_n = state->hysteresis_force_n;
}

/* du/dtravel, ISMAIL: 1 - |u|^n while loading, 1 + (2*sigma - 1)*|u|^n while unloading. */
static double trocar_gain(double u)
{
//@if n_is_one
    const double power = fabs(u);
//@else
//@if n_is_two
    const double power = u * u;
//@else
    const double power = trocar_power(fabs(u), trocar_exponent);
//@end
//@end
    const double slope = u < 0.0 ? trocar_unloading : -1.0;
    return 1.0 + slope * power;
}

/* Change of u over which the gain is taken as a straight line. */
static double trocar_stride(double u)
{
//@if n_is_one
    (void)u;
    return HUGE_VAL;
//@else
    const double bend = trocar_most(0.5 * (1.0 - fabs(u)), 0.25 / trocar_most(trocar_exponent, 1.0));
    return trocar_least(0.0625, bend);
//@end
}

/* u = f*sgn(v)/F_c after travel = k*|dx|/F_c. It only rises, first to 0, then towards 1. At most 50 parts. */
static double trocar_load(double u, double travel)
{
    double gain = trocar_gain(u);
    int part;
    for (part = 0; part < 50 && travel > 0.0 && gain > 0.0; ++part) {
        const double end = u < 0.0 ? 0.0 : 1.0;
        const double stride = part < 48 ? trocar_stride(u) : HUGE_VAL;
        const double far = trocar_least(trocar_least(end - u, stride), gain * travel);
        const double there = far < end - u ? u + far : end;
        const double gain_there = trocar_gain(there);
        const double needed = far < gain * travel ? trocar_chord_travel(far, gain, gain_there) : HUGE_VAL;
        if (needed < travel) {
            u = there;
            gain = gain_there;
            travel -= needed;
        } else {
            return u + trocar_least(gain * travel * trocar_filled((gain - gain_there) / far * travel), far);
        }
    }
    return u;
}

/* df/dx = k*(1 - |f/F_c|^n*(1 - sigma + sigma*sgn(f*v))), ISMAIL; F = f + beta*v. */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    const double s = trocar_sign(displacement);
    double hysteresis = state->hysteresis_force_n, force;
    (void)duration;
    if (s != 0.0) {
        const double travel = trocar_stiffness_n_m * fabs(displacement) / trocar_coulomb_force_n;
        /* A state of a model with a greater F_c, such as before a change of it. */
        const double part = trocar_within(s * hysteresis / trocar_coulomb_force_n, 1.0);
        hysteresis = s * trocar_coulomb_force_n * trocar_load(part, travel);
    }
    force = hysteresis + trocar_viscous_damping_n_s_m * velocity;
    if (fabs(force) <= trocar_greatest) {
        state->hysteresis_force_n = hysteresis;
        state->seal_force_n = force;
    }
}
