//@state
    double deflection_m;                 /* z of the bank */
    double element_force_n[@ELEMENTS@]; /* f_i, |f_i| <= F_i */
    double seal_force_n;                 /* of the seal alone */
//@code
/* F_h, the sum of f_i, N. */
static double trocar_bank_force(const trocar_state *state)
{
    double sum = -0.0;
    int i;
    for (i = 0; i < trocar_elements; ++i) {
        sum += state->element_force_n[i];
    }
    return sum;
}

static void trocar_rest_with(trocar_state *state, double force)
{
    const double held = trocar_held(force, trocar_sliding.static_force_n);
    int i;
    state->deflection_m = 0.0;
    for (i = 0; i < trocar_elements; ++i) {
        double deflection;
        state->element_force_n[i] = held / trocar_limit_n * trocar_limit_force_n[i];
        deflection = state->element_force_n[i] / trocar_stiffness_n_m[i];
        /* z is that of the longest element, the one that never yields. */
        if (fabs(deflection) > fabs(state->deflection_m)) {
            state->deflection_m = deflection;
        }
    }
    state->seal_force_n = trocar_bank_force(state);
}

/* Sum of k_i of the elements that have not yielded, N/m; *room is the way of z to the next one that does, m. */
static double trocar_bank_ahead(const trocar_state *state, double heading, double *room)
{
    double stiffness = 0.0;
    int i;
    *room = HUGE_VAL;
    for (i = 0; i < trocar_elements; ++i) {
        const double reserve = trocar_limit_force_n[i] - heading * state->element_force_n[i];
        if (reserve > 0.0) {
            stiffness += trocar_stiffness_n_m[i];
            *room = trocar_least(*room, reserve / trocar_stiffness_n_m[i]);
        }
    }
    return stiffness;
}

/* Moves z by way (m) towards heading; returns F_h, N. */
static double trocar_bank_advance(trocar_state *state, double heading, double way)
{
    double sum = 0.0;
    int i;
    for (i = 0; i < trocar_elements; ++i) {
        const double loaded = heading * state->element_force_n[i] + trocar_stiffness_n_m[i] * way;
//@if single
        const int yields = loaded >= (1.0 - 5e-6) * trocar_limit_force_n[i];
//@else
        const int yields = loaded >= (1.0 - 1e-14) * trocar_limit_force_n[i];
//@end
        state->element_force_n[i] = heading * (yields ? trocar_limit_force_n[i] : loaded);
        sum += state->element_force_n[i];
    }
    return sum;
}

/* dz/dx = 1 - sgn(r)*|r|^n, LAMPAERT. */
static double trocar_bank_gain(double ratio)
{
//@if n_is_one
    return 1.0 - ratio;
//@else
//@if n_is_two
    return 1.0 - ratio * fabs(ratio);
//@else
    const double power = trocar_least(trocar_power(fabs(ratio), trocar_exponent), trocar_greatest);
    return 1.0 - (ratio < 0.0 ? -power : power);
//@end
//@end
}

/* Change of r over which the gain is taken as a straight line. */
static double trocar_stride(double ratio)
{
//@if n_is_one
    (void)ratio;
    return HUGE_VAL;
//@else
    const double bend = trocar_most(0.5 * fabs(1.0 - ratio), 0.25 / trocar_most(trocar_exponent, 1.0));
    return trocar_least(0.125 * trocar_most(fabs(ratio), 1.0), bend);
//@end
}

/* Moves the bank while the instrument travels by left (m) towards s; returns F_h, N. At most 57 parts. */
static double trocar_load(trocar_state *state, double s, double level, double left)
{
    double hysteresis = trocar_bank_force(state), gain = 0.0;
    int part, strides = 0, known = 0;
    for (part = 0; part < 57 && left > 0.0; ++part) {
        const double ratio = s * hysteresis / level;
        double heading, stiffness, room, start, settled, stride, far, there, end, needed, moved;
        gain = known ? gain : trocar_bank_gain(ratio);
        heading = s * trocar_sign(gain);
        stiffness = trocar_bank_ahead(state, heading, &room);
        if (heading == 0.0 || stiffness == 0.0) {
            break; /* at equilibrium, or with all elements yielded, nothing moves */
        }
        start = fabs(gain);
        settled = fabs(level - s * hysteresis) / stiffness;
        stride = strides < 24 ? trocar_stride(ratio) * level / stiffness : HUGE_VAL;
        strides += stride < room ? 1 : 0;
        far = trocar_least(trocar_least(trocar_least(room, settled), stride), start * left);
        there = far < settled ? trocar_bank_gain(ratio + s * heading * stiffness * far / level) : 0.0;
        end = fabs(there);
        needed = far < start * left ? trocar_chord_travel(far, start, end) : HUGE_VAL;
        if (needed < left) {
            left -= needed;
            gain = there;
            known = 1;
            moved = far;
        } else {
            moved = trocar_least(start * left * trocar_filled((start - end) / far * left), far);
            left = 0.0;
        }
        state->deflection_m += heading * moved;
        hysteresis = trocar_bank_advance(state, heading, moved);
    }
    return hysteresis;
}

/* dz/dt = v*(1 - sgn(r)*|r|^n), r = F_h/(g*sgn(v)); F = F_h + sigma_1*dz/dt + sigma_2*v, LAMPAERT. */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    const double s = trocar_sign(velocity);
    double level, hysteresis, force;
    (void)duration;
    if (!(trocar_limit_n + trocar_damping_n_s_m * fabs(velocity) <= trocar_greatest)) {
        return;
    }
    if (s == 0.0) {
        state->seal_force_n = trocar_bank_force(state);
        return;
    }
    level = trocar_level(&trocar_sliding, fabs(velocity));
    hysteresis = trocar_load(state, s, level, fabs(displacement));
    force = hysteresis + trocar_sliding.viscous_damping_n_s_m * velocity;
//@if micro_damping
    force += trocar_micro_damping_n_s_m * velocity * trocar_bank_gain(s * hysteresis / level);
//@end
    state->seal_force_n = force;
}

