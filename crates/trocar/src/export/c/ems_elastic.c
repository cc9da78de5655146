/* Two power series at once by Estrin's scheme. */
static void trocar_series(const double a[@TERMS@][2], double t, double *first, double *second)
{
    const double t2 = t * t;
//@if beyond_cubic
    const double t4 = t2 * t2;
//@end
    double sum[2];
    int i;
    for (i = 0; i < 2; ++i) {
        sum[i] = @LOW@;
//@if beyond_cubic
        sum[i] += (@HIGH@) * t4;
//@end
    }
    *first = sum[0];
    *second = sum[1];
}

static const trocar_span *trocar_span_at(const trocar_element *e, double z)
{
    return &e->span[z < e->joins_m[0] ? 0 : z < e->joins_m[1] ? 1 : 2];
}

/* M(z) and h(z), N: a straight line and 0 outside [-c, c]. */
static double trocar_middle_and_gap(const trocar_element *e, double z, double *gap)
{
    const trocar_span *span;
    double middle;
    *gap = 0.0;
    if (z > e->half_width_m) {
        return e->end_force_n[1] + e->end_stiffness_n_m[1] * (z - e->half_width_m);
    }
    if (z < -e->half_width_m) {
        return e->end_force_n[0] + e->end_stiffness_n_m[0] * (z + e->half_width_m);
    }
    span = trocar_span_at(e, z);
    trocar_series(span->force_n, (z - span->middle_m) * span->inverse_half_1_m, &middle, gap);
    *gap = *gap > 0.0 ? *gap : 0.0;
    return middle;
}

/* F_e after a monotone motion from deflection `from` with yield force q to deflection `to`; *reached is q there:
 * clamp(q + kappa*(to - from), -h, h). */
static double trocar_reach(const trocar_element *e, double from, double q, double to, double *reached)
{
    double gap;
    const double middle = trocar_middle_and_gap(e, to, &gap);
    const double trial = q + e->yield_stiffness_n_m * (to - from);
    *reached = trial > gap ? gap : trial < -gap ? -gap : trial;
    return middle + *reached;
}

