//@if stribeck
/* (u/v_s)^delta of EMS (11). */
static double trocar_stribeck_exponent(const trocar_contact *c, double u)
{
    const double x = u * c->inverse_stribeck_velocity_s_m;
//@if gaussian
    if (c->stribeck_exponent == 2.0) {
        return x * x;
    }
//@end
//@if shaped
    if (c->stribeck_exponent != 1.0) {
        return trocar_power(x, c->stribeck_exponent);
    }
//@end
    return x;
}

//@end
//@if level
/* g(|v|), N, EMS (11). */
static double trocar_level(const trocar_contact *c, double v)
{
//@if stribeck
//@if rational
    return c->coulomb_force_n + c->surplus_force_n / (1.0 + trocar_stribeck_exponent(c, fabs(v)));
//@else
    return c->coulomb_force_n + c->surplus_force_n * trocar_decay(trocar_stribeck_exponent(c, fabs(v)));
//@end
//@else
    (void)v;
    return c->coulomb_force_n;
//@end
}

//@end
//@if stribeck
//@if ems
/* Derivative by u of (u/v_s)^delta = exponent. */
static double trocar_stribeck_growth(const trocar_contact *c, double u, double exponent)
{
    const double inverse = c->inverse_stribeck_velocity_s_m;
//@if gaussian
    if (c->stribeck_exponent == 2.0) {
        return 2.0 * u * inverse * inverse;
    }
//@end
//@if shaped
    if (c->stribeck_exponent != 1.0) {
        return u > 0.0 ? c->stribeck_exponent * exponent / u : c->stribeck_exponent > 1.0 ? 0.0 : HUGE_VAL;
    }
//@end
    (void)u;
    (void)exponent;
    return inverse;
}

/* d/du of fall = (F_s - F_c)*exp(-(u/v_s)^delta). */
static double trocar_stribeck_slope(double fall, double growth)
{
    return fall > 0.0 ? -fall * growth : 0.0;
}

//@end
//@end
