//@state
    double hysteresis_force_n; /* f, without the viscous part, |f| <= F_c */
    double seal_force_n;       /* of the seal alone */
    double direction;          /* of the last motion: 1, 0, -1 */
    double remainder;          /* y = 1 - s*f/F_c */
//@if inverse_power
    double inverse_power; /* y^(1 - i) */
//@end
//@code
static void trocar_rest_with(trocar_state *state, double force)
{
    state->hysteresis_force_n = trocar_held(force, trocar_coulomb_force_n);
    state->seal_force_n = state->hysteresis_force_n;
    state->direction = 0.0;
    state->remainder = 1.0;
//@if inverse_power
    state->inverse_power = 1.0;
//@end
}

//@if inverse_power
/* value, the largest number where it is none or infinite. */
static double trocar_finite(double value)
{
    return value <= trocar_greatest ? value : trocar_greatest;
}

//@end
/* The solution of dy/dtravel = -y^i after travel = sigma*|dx|/F_c. */
static void trocar_yield(trocar_state *state, double travel)
{
//@if inverse_power
    const double m = trocar_exponent_less_one;
    const double growth = m * travel / state->inverse_power;
    double logarithm;
    if (growth <= -1.0 || state->remainder == 0.0) {
        state->remainder = 0.0;
        state->inverse_power = m < 0.0 ? 0.0 : trocar_greatest;
        return;
    }
    logarithm = growth < HUGE_VAL ? trocar_logarithm_of_one_plus(growth)
                                  : log(m * travel) + m * log(state->remainder);
    state->remainder *= trocar_decay(logarithm / m);
    state->inverse_power = trocar_finite(state->inverse_power + m * travel);
//@else
    state->remainder *= trocar_decay(travel);
//@end
}

/* df/dx = sigma*|y|^i*sgn(y), y = 1 - (f/F_c)*sgn(v); F = f + beta*v. */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    trocar_state next = *state;
    const double s = trocar_sign(displacement);
    (void)duration;
    if (s != 0.0) {
        if (s != next.direction) {
            next.remainder = 1.0 - s * next.hysteresis_force_n / trocar_coulomb_force_n;
//@if inverse_power
            next.inverse_power = trocar_finite(trocar_power(next.remainder, -trocar_exponent_less_one));
//@end
            next.direction = s;
        }
        trocar_yield(&next, trocar_stiffness_n_m * fabs(displacement) / trocar_coulomb_force_n);
        next.hysteresis_force_n = s * trocar_coulomb_force_n * (1.0 - next.remainder);
    }
    next.seal_force_n = next.hysteresis_force_n + trocar_viscous_damping_n_s_m * velocity;
    if (fabs(next.seal_force_n) <= trocar_greatest) {
        *state = next;
    }
}

