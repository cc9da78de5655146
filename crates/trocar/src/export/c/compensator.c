
/* The observer. F_tissue = reading - offset - m*(a + g) - F_trocar, with the model driven by x/level:
 * F_trocar = F_0(x) + gain(x)*level*[F - F_beta + viscosity*F_beta]. */

//@if clock
//@if single
static trocar_time trocar_later(trocar_time time, double duration)
{
    const double bounded = duration < 1e6 ? duration : 1e6;
    uint32_t whole;
    time.rest_s += bounded;
    whole = (uint32_t)time.rest_s;
    time.rest_s -= (double)whole;
    time.whole_s += whole;
    return time;
}

static double trocar_since(trocar_time then, trocar_time now)
{
    const uint32_t whole = now.whole_s - then.whole_s;
    return (double)whole + (now.rest_s - then.rest_s);
}

static trocar_time trocar_time_zero(void)
{
    trocar_time zero = { 0, 0.0 };
    return zero;
}
//@else
static trocar_time trocar_later(trocar_time time, double duration)
{
    return time + duration;
}

static double trocar_since(trocar_time then, trocar_time now)
{
    return now - then;
}

static trocar_time trocar_time_zero(void)
{
    return 0.0;
}
//@end

//@end
static int trocar_is_finite(double value)
{
    return fabs(value) <= trocar_greatest;
}

/* The seal alone, stepped where the motion is known to be finite. */
//@if ems
static void trocar_move_elements(const trocar_element *elements, trocar_state *state, double displacement,
                                 double duration)
{
    trocar_step_elements(elements, state, displacement / duration, duration);
}

//@end
static void trocar_move_seal(trocar_state *state, double displacement, double duration)
{
//@if ems
    trocar_move_elements(trocar_element_constants, state, displacement, duration);
//@else
    trocar_step_seal(state, displacement / duration, displacement, duration);
//@end
}

/* Between the extreme states at rest, `part` from -1 to 1. */
static void trocar_rest_between(trocar_state *state, double part)
{
//@if ems
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        const trocar_element *e = &trocar_element_constants[k];
        trocar_rest_element(e, &state->element[k], part * e->half_width_m);
    }
//@else
    trocar_rest_with(state, part * trocar_greatest);
//@end
}

/* The part of the force that grows with the slip speed. */
static double trocar_viscous_force(const trocar_state *state, double velocity)
{
//@if ems
    double force = -0.0;
    int k;
    (void)velocity;
    for (k = 0; k < trocar_elements; ++k) {
        const double slip = state->element[k].slip_velocity_m_s;
        force += trocar_slip_damping_n_s_m[k][!(slip < 0.0)] * slip;
    }
    return force;
//@else
    (void)state;
    return trocar_slip_damping_n_s_m * velocity;
//@end
}

/* Invalid samples. */

static int trocar_motion_fault(const trocar_compensator *o, double position, double duration)
{
    double way;
    if (!trocar_is_finite(position)) {
        return trocar_NO_POSITION;
    }
    if (!o->has_position) {
        return trocar_NO_FAULT;
    }
    way = fabs(position - o->position_m);
    if (!(duration > 0.0 && trocar_is_finite(duration))) {
        return trocar_NO_DURATION;
    }
    if (way > 1e-3 && way > 1.0 * duration) {
        return trocar_JUMP;
    }
    return duration > 0.2 ? trocar_GAP : trocar_NO_FAULT;
}

static int trocar_is_frozen(trocar_watch *watch, double reading, double duration)
{
    const double passed = duration > 0.0 && trocar_is_finite(duration) ? duration : 0.0;
    double least;
    if (!watch->is_known || watch->reading_n != reading) {
        if (watch->is_known) {
            watch->usual_s += 0.02 * (watch->time_s + passed - watch->usual_s);
        }
        watch->is_known = 0;
        return 0;
    }
    watch->time_s += passed;
    watch->samples += 1;
    least = 10.0 * watch->usual_s > 0.04 ? 10.0 * watch->usual_s : 0.04;
    return watch->time_s >= least && watch->samples >= 20
        && watch->high_n - watch->low_n > trocar_least_change_n;
}

static int trocar_reading_fault(trocar_watch *watch, double reading, double duration)
{
    if (!(fabs(reading) <= 1e6)) {
        return trocar_NO_READING;
    }
    if (fabs(reading) >= trocar_sensor_limit_n) {
        return trocar_SATURATED;
    }
    return trocar_is_frozen(watch, reading, duration) ? trocar_FROZEN : trocar_NO_FAULT;
}

/* The model's force that belongs to a reading. */
static void trocar_follow(trocar_watch *watch, double model, double reading)
{
    if (!watch->is_known) {
        watch->is_known = 1;
        watch->reading_n = reading;
        watch->time_s = 0.0;
        watch->samples = 1;
        watch->low_n = watch->high_n = model;
    }
    watch->low_n = model < watch->low_n ? model : watch->low_n;
    watch->high_n = model > watch->high_n ? model : watch->high_n;
}

/* The sign of the readings: over a reversal of the motion they change as the friction does. */

static void trocar_break_off_sign(trocar_sign_watch *sign)
{
    sign->now.is_known = sign->before.is_known = 0;
}

/* Three reversals in succession decide. */
static void trocar_judge_sign(trocar_sign_watch *sign, double ratio)
{
    if (ratio > 0.1) {
        sign->run = sign->run < 0 ? 1 : sign->run < 3 ? sign->run + 1 : 3;
    } else if (ratio < -0.1) {
        sign->run = sign->run > 0 ? -1 : sign->run > -3 ? sign->run - 1 : -3;
    } else {
        sign->run = 0;
    }
    if (sign->run == 3 || sign->run == -3) {
        sign->is_opposite = sign->run < 0;
    }
}

/* A sample while the seal slides. */
static void trocar_take_sign(trocar_sign_watch *sign, double position, int inserts, double reading, double model)
{
    trocar_one_way *now = &sign->now;
    const trocar_one_way *before = &sign->before;
    if (!now->is_known || now->inserts != inserts) {
        now->is_known = 1;
        now->inserts = inserts;
        now->from_m = position;
        now->reading_n = reading;
        now->model_n = model;
    }
    now->reading_n += 0.0625 * (reading - now->reading_n);
    now->model_n += 0.0625 * (model - now->model_n);
    if (fabs(position - now->from_m) < trocar_sign_travel_m) {
        return;
    }
    if (before->is_known && before->inserts != inserts) {
        const double change = now->model_n - before->model_n;
        if (fabs(change) < trocar_least_change_n) {
            return;
        }
        trocar_judge_sign(sign, (now->reading_n - before->reading_n) / change);
    }
    sign->before = *now;
}

//@if mass
/* Inertia: a parabola through the positions of the last 30 ms, or of 8 samples. */

static void trocar_pass(trocar_inertia *inertia, trocar_time time, double position)
{
    inertia->past[inertia->next].time = time;
    inertia->past[inertia->next].position_m = position;
    inertia->next = (inertia->next + 1) % 128;
    inertia->count = inertia->count < 128 ? inertia->count + 1 : 128;
}

static void trocar_restart_inertia(trocar_inertia *inertia, trocar_time time, double position)
{
    inertia->next = inertia->count = 0;
    inertia->acceleration_m_s2 = 0.0;
    trocar_pass(inertia, time, position);
}

/* About the newest sample, with time in units of the window; 0 without an answer. */
static double trocar_fit_acceleration(const trocar_inertia *inertia, trocar_time now, double here)
{
    double n = 0.0, t1 = 0.0, t2 = 0.0, t3 = 0.0, t4 = 0.0, x0 = 0.0, x1 = 0.0, x2 = 0.0;
    double window, minor, whole, curvature, acceleration;
    int k;
    if (inertia->count < 8) {
        return 0.0;
    }
    window = trocar_since(inertia->past[(inertia->next + 128 - 8) % 128].time, now);
    window = window > 0.03 ? window : 0.03;
    for (k = 0; k < inertia->count; ++k) {
        const double t = -trocar_since(inertia->past[k].time, now) / window;
        const double x = inertia->past[k].position_m - here, tt = t * t;
        if (t < -1.0) {
            continue;
        }
        n += 1.0;
        t1 += t;
        t2 += tt;
        t3 += t * tt;
        t4 += tt * tt;
        x0 += x;
        x1 += x * t;
        x2 += x * tt;
    }
    /* Cramer's rule. */
    minor = n * t2 - t1 * t1;
    whole = n * (t2 * t4 - t3 * t3) - t1 * (t1 * t4 - t2 * t3) + t2 * (t1 * t3 - t2 * t2);
    curvature = (x2 * minor - x1 * (n * t3 - t1 * t2) + x0 * (t1 * t3 - t2 * t2)) / whole;
    acceleration = 2.0 * curvature / (window * window);
    return trocar_is_finite(acceleration) ? acceleration : 0.0;
}

static void trocar_advance_inertia(trocar_inertia *inertia, trocar_time time, double position)
{
    trocar_pass(inertia, time, position);
    inertia->acceleration_m_s2 = trocar_fit_acceleration(inertia, time, position);
}

//@end
/* The position profile at the seal's force, and the other way. */

static double trocar_along(double position, double force)
{
//@if profile
    return trocar_at_position(trocar_offset_n, 0.0, position) + trocar_at_position(trocar_gain, 1.0, position) * force;
//@else
    (void)position;
    return force;
//@end
}

static double trocar_slope_at(double position)
{
//@if profile
    return trocar_at_position(trocar_gain, 1.0, position);
//@else
    (void)position;
    return 1.0;
//@end
}

static double trocar_without_profile(double position, double force)
{
//@if profile
    return (force - trocar_at_position(trocar_offset_n, 0.0, position)) / trocar_at_position(trocar_gain, 1.0, position);
//@else
    (void)position;
    return force;
//@end
}

//@if adapts
/* Cells of 1 mm along the track. */
static int32_t trocar_cell_at(double position)
{
    const double cell = floor(position / 1e-3);
    return cell <= -2147483520.0 ? -2147483647 - 1 : cell >= 2147483520.0 ? 2147483647 : (int32_t)cell;
}

/* Index of a cell in the memory of 512. */
static int trocar_place(int32_t cell)
{
    return (int)((uint32_t)cell % 512u);
}

/* Friction scale and viscosity, from crossings of a cell in both directions. */

static void trocar_diagonal(trocar_adapter *a, double first, double second)
{
    a->covariance[0][0] = first;
    a->covariance[0][1] = a->covariance[1][0] = 0.0;
    a->covariance[1][1] = second;
}

static void trocar_break_off_adapter(trocar_adapter *a)
{
    int side, k;
    a->is_crossing = a->is_sliding = 0;
    for (side = 0; side < 2; ++side) {
        for (k = 0; k < 512; ++k) {
            a->memory[side][k].is_known = 0;
        }
    }
}

static void trocar_reset_adapter(trocar_adapter *a)
{
    trocar_break_off_adapter(a);
    a->estimate[0] = a->estimate[1] = 1.0;
    trocar_diagonal(a, trocar_prior[0], trocar_prior[1]);
    a->time = a->learnt = a->loaded = trocar_time_zero();
    a->has_learnt = a->has_load = a->contact = 0;
    a->outliers = 0;
}

/* Contact with tissue, now or recently. */
static int trocar_is_latched(const trocar_adapter *a)
{
    return a->contact || (a->has_load && trocar_since(a->loaded, a->time) < 4.0);
}

static int trocar_is_adapting(const trocar_adapter *a)
{
    return !trocar_is_latched(a) && a->has_learnt && trocar_since(a->learnt, a->time) < 5.0;
}

/* The uncertainty grows with time. */
static void trocar_pass_time(trocar_adapter *a, double duration)
{
    static const double most[2] = { 0.15 * 0.15, 0.3 * 0.3 }, growth[2] = { 0.0015, 0.01 };
    int k;
    a->time = trocar_later(a->time, duration);
    for (k = 0; k < 2; ++k) {
        const double now = a->covariance[k][k];
        if (now < most[k]) {
            const double grown = now + growth[k] * growth[k] * duration;
            a->covariance[k][k] = grown < most[k] ? grown : most[k];
        }
    }
}

/* first + factor*second. */
static trocar_slid trocar_combined(const trocar_slid *first, double factor, const trocar_slid *second)
{
    trocar_slid sum;
    sum.reading_n = first->reading_n + factor * second->reading_n;
    sum.dry_n = first->dry_n + factor * second->dry_n;
    sum.viscous_n = first->viscous_n + factor * second->viscous_n;
    return sum;
}

static trocar_slid trocar_scaled(const trocar_slid *of, double factor)
{
    trocar_slid scaled;
    scaled.reading_n = factor * of->reading_n;
    scaled.dry_n = factor * of->dry_n;
    scaled.viscous_n = factor * of->viscous_n;
    return scaled;
}

/* Reading less the model's force. */
static double trocar_unexplained(const trocar_adapter *a, const trocar_slid *of)
{
    return of->reading_n - a->estimate[0] * of->dry_n - a->estimate[1] * of->viscous_n;
}

static double trocar_variance_of(const trocar_adapter *a, const trocar_slid *of)
{
    return a->covariance[0][0] * of->dry_n * of->dry_n + 2.0 * a->covariance[0][1] * of->dry_n * of->viscous_n
         + a->covariance[1][1] * of->viscous_n * of->viscous_n;
}

/* One update of the Kalman filter with the part that reverses. */
static void trocar_update(trocar_adapter *a, const trocar_slid *turns)
{
    static const double bounds[2][2] = { { 0.1, 2.0 }, { 0.0, 4.0 } };
    const double row[2] = { turns->dry_n, turns->viscous_n };
    const double innovation = trocar_unexplained(a, turns);
    const double noise = 2.0 * trocar_sigma_n * trocar_sigma_n * 32.0;
    double gain[2], variance;
    int k, j;
    for (k = 0; k < 2; ++k) {
        gain[k] = a->covariance[k][0] * row[0] + a->covariance[k][1] * row[1];
    }
    variance = row[0] * gain[0] + row[1] * gain[1] + noise;
    if (innovation * innovation > 3.0 * 3.0 * variance) {
        a->outliers += 1;
        if (a->outliers >= 8) { /* a change: the prior is widened to cover any */
            a->outliers = 0;
            trocar_diagonal(a, 0.5 * 0.5, 0.5 * 0.5);
        }
        return;
    }
    a->outliers = 0;
    a->learnt = a->time;
    a->has_learnt = 1;
    for (k = 0; k < 2; ++k) {
        const double moved = a->estimate[k] + gain[k] * innovation / variance;
        a->estimate[k] = moved < bounds[k][0] ? bounds[k][0] : moved > bounds[k][1] ? bounds[k][1] : moved;
        for (j = 0; j < 2; ++j) {
            a->covariance[k][j] -= gain[k] * gain[j] / variance;
        }
    }
}

/* From a crossing, the opposite one before it, and the one in its own direction before that. */
static void trocar_learn_from(trocar_adapter *a, const trocar_slid *now, const trocar_slid *across,
                              const trocar_slid *first)
{
    const double sigma = trocar_sigma_n;
    trocar_slid mean = trocar_combined(now, 1.0, across), turns = trocar_combined(now, -1.0, across);
    double load;
    int same = 0;
    mean = trocar_scaled(&mean, 0.5);
    load = trocar_unexplained(a, &mean);
    a->contact = load * load > 3.0 * 3.0 * (sigma * sigma + trocar_variance_of(a, &mean));
    if (a->contact) {
        a->loaded = a->time;
        a->has_load = 1;
    }
    if (first) {
        const trocar_slid change = trocar_combined(now, -1.0, first);
        const double noise = 2.0 * sigma * sigma + trocar_variance_of(a, &change);
        const double left = trocar_unexplained(a, &change);
        same = left * left < 3.0 * 3.0 * noise;
    }
    if (!trocar_is_latched(a) && same) {
        trocar_update(a, &turns);
    }
}

static int trocar_is_recent(const trocar_adapter *a, const trocar_crossing *crossing)
{
    return crossing->is_known && crossing->cell == a->cell && trocar_since(crossing->time, a->time) < 20.0;
}

static void trocar_finish_crossing(trocar_adapter *a)
{
    trocar_crossing *along, *across;
    trocar_slid mean;
    if (!a->is_crossing) {
        return;
    }
    a->is_crossing = 0;
    mean = trocar_scaled(&a->sum, 1.0 / a->samples);
    along = &a->memory[a->inserts][trocar_place(a->cell)];
    across = &a->memory[!a->inserts][trocar_place(a->cell)];
    if (trocar_is_recent(a, across)) {
        const int is_first = trocar_is_recent(a, along)
                          && trocar_since(along->time, a->time) > trocar_since(across->time, a->time);
        trocar_learn_from(a, &mean, &across->mean, is_first ? &along->mean : 0);
    }
    along->cell = a->cell;
    along->is_known = 1;
    along->time = a->time;
    along->mean = mean;
}

/* 1 once a slide has lasted for a quarter of the deformation width, m. */
static int trocar_settle(trocar_adapter *a, int slides, int inserts, double position, double width)
{
    if (!slides) {
        a->is_sliding = 0;
        trocar_finish_crossing(a);
        return 0;
    }
    if (!a->is_sliding || a->slide_inserts != inserts) {
        a->is_sliding = 1;
        a->slide_inserts = inserts;
        a->slide_from_m = position;
    }
    return fabs(position - a->slide_from_m) >= 0.25 * width;
}

/* A sample of a slide. */
static void trocar_take_slide(trocar_adapter *a, double position, int inserts, const trocar_slid *now)
{
    const int32_t cell = trocar_cell_at(position);
    if (!a->is_crossing || a->cell != cell || a->inserts != inserts) {
        trocar_finish_crossing(a);
        a->is_crossing = 1;
        a->cell = cell;
        a->inserts = inserts;
        a->sum.reading_n = a->sum.dry_n = a->sum.viscous_n = 0.0;
        a->samples = 0.0;
    }
    a->sum = trocar_combined(&a->sum, 1.0, now);
    a->samples += 1.0;
}

/* Whether another friction scale explains the readings better: the model at seven of them side by side. */

static const double trocar_levels[7] = { 0.18, 0.25, 0.35, 0.5, 0.71, 1.0, 1.41 };

static void trocar_forget_pairs(trocar_bank *bank)
{
    int k;
    for (k = 0; k < 24; ++k) {
        bank->pairs[k].is_known = 0;
    }
    bank->next = 0;
}

static void trocar_break_off_bank(trocar_bank *bank)
{
    int side, k;
    bank->current.is_known = 0;
    for (side = 0; side < 2; ++side) {
        for (k = 0; k < 512; ++k) {
            bank->memory[side][k].is_known = 0;
        }
    }
    trocar_forget_pairs(bank);
}

/* All models at rest with a force. */
static void trocar_start_bank(trocar_bank *bank, double force)
{
    int h;
    for (h = 0; h < 7; ++h) {
        trocar_rest_with(&bank->states[h], force / trocar_levels[h]);
    }
    trocar_break_off_bank(bank);
}

static void trocar_advance_bank(trocar_bank *bank, double displacement, double duration)
{
    int h;
    for (h = 0; h < 7; ++h) {
        trocar_move_seal(&bank->states[h], displacement / trocar_levels[h], duration);
    }
    bank->time = trocar_later(bank->time, duration);
}

/* The scale at which the force would have reversed as the reading did, and the load that remains; NaN outside those
 * tried. */
static void trocar_find_level(trocar_pair *pair, const trocar_bank_crossing *now, const trocar_bank_crossing *before)
{
    double loads[2], part, span;
    int h, k;
    pair->level = (double)NAN;
    pair->load_n = (double)NAN;
    for (h = 0; h < 6; ++h) {
        if ((pair->turns_n[h] - pair->turn_n) * (pair->turns_n[h + 1] - pair->turn_n) <= 0.0) {
            break;
        }
    }
    if (h == 6) {
        return;
    }
    for (k = 0; k < 2; ++k) {
        loads[k] = 0.5 * (now->reading_n + before->reading_n - now->forces_n[h + k] - before->forces_n[h + k]);
    }
    span = pair->turns_n[h + 1] - pair->turns_n[h];
    part = span == 0.0 ? 0.0 : (pair->turn_n - pair->turns_n[h]) / span;
    pair->level = trocar_levels[h] + part * (trocar_levels[h + 1] - trocar_levels[h]);
    pair->load_n = loads[0] + part * (loads[1] - loads[0]);
}

static void trocar_compare(trocar_bank *bank, const trocar_bank_crossing *now, const trocar_bank_crossing *before)
{
    double turns[7], low = HUGE_VAL, high = -HUGE_VAL;
    trocar_pair *pair = &bank->pairs[bank->next];
    int h;
    for (h = 0; h < 7; ++h) {
        turns[h] = now->forces_n[h] - before->forces_n[h];
        low = turns[h] < low ? turns[h] : low;
        high = turns[h] > high ? turns[h] : high;
    }
    if (high - low < 12.0 * trocar_sigma_n) {
        return;
    }
    bank->stroke += bank->inserts != bank->inserted ? 1u : 0u;
    bank->inserted = bank->inserts;
    for (h = 0; h < 7; ++h) {
        pair->turns_n[h] = turns[h];
    }
    pair->turn_n = now->reading_n - before->reading_n;
    trocar_find_level(pair, now, before);
    pair->variance_n2 = now->variance_n2 + before->variance_n2;
    pair->stroke = bank->stroke;
    pair->is_known = 1;
    bank->next = (bank->next + 1) % 24;
}

static void trocar_finish_bank_crossing(trocar_bank *bank)
{
    trocar_bank_crossing now = bank->current;
    const trocar_bank_crossing *across;
    int h;
    if (!now.is_known) {
        return;
    }
    across = &bank->memory[!bank->inserts][trocar_place(now.cell)];
    bank->current.is_known = 0;
    now.reading_n /= bank->samples;
    now.variance_n2 /= bank->samples;
    for (h = 0; h < 7; ++h) {
        now.forces_n[h] /= bank->samples;
    }
    now.time = bank->time;
    if (across->is_known && across->cell == now.cell && trocar_since(across->time, bank->time) < 20.0) {
        trocar_compare(bank, &now, across);
    }
    bank->memory[bank->inserts][trocar_place(now.cell)] = now;
}

/* A reading without offset, inertia, profile and the increase of the viscous part; the model's error has `variance`. */
static void trocar_take_reading(trocar_bank *bank, double position, int inserts, double reading, double variance)
{
    trocar_bank_crossing *current = &bank->current;
    const int32_t cell = trocar_cell_at(position);
    int h;
    if (current->is_known && (current->cell != cell || bank->inserts != inserts)) {
        trocar_finish_bank_crossing(bank);
    }
    if (!current->is_known) {
        current->is_known = 1;
        current->cell = cell;
        bank->inserts = inserts;
        bank->samples = current->reading_n = current->variance_n2 = 0.0;
        for (h = 0; h < 7; ++h) {
            current->forces_n[h] = 0.0;
        }
    }
    bank->samples += 1.0;
    current->reading_n += reading;
    current->variance_n2 += variance;
    for (h = 0; h < 7; ++h) {
        current->forces_n[h] += trocar_levels[h] * trocar_seal_force(&bank->states[h]);
    }
}

/* Index of the scale below `level`, and the part of the way to the next. */
static int trocar_place_of_level(double level, double *part)
{
    int h = 5;
    while (h > 0 && !(trocar_levels[h] <= level)) {
        --h;
    }
    *part = (level - trocar_levels[h]) / (trocar_levels[h + 1] - trocar_levels[h]);
    return h;
}

/* Mean of the squared errors of the last `number` pairs at a scale, beyond the noise. */
static double trocar_beyond_noise(const trocar_bank *bank, int number, int h, double part)
{
    double squares = 0.0, count = 0.0;
    int back;
    for (back = 1; back <= number; ++back) {
        const trocar_pair *pair = &bank->pairs[(bank->next + 24 - back) % 24];
        if (pair->is_known) {
            const double error = pair->turn_n - pair->turns_n[h] - part * (pair->turns_n[h + 1] - pair->turns_n[h]);
            squares += error * error - 2.0 * 2.0 * pair->variance_n2;
            count += 1.0;
        }
    }
    return count > 0.0 ? squares / count : 0.0;
}

/* Variance by which the last pairs contradict the present scale. */
static double trocar_doubt(const trocar_bank *bank, double present)
{
    double part, recent, newest, doubt;
    const int h = trocar_place_of_level(present, &part);
    recent = trocar_beyond_noise(bank, 12, h, part);
    newest = trocar_beyond_noise(bank, 3, h, part);
    doubt = recent > newest ? recent : newest;
    return doubt > 0.0 ? doubt : 0.0;
}

/* The median scale of 24 pairs; NaN above all numbers. */
static double trocar_median_level(const trocar_bank *bank)
{
    double levels[24];
    int k, j;
    for (k = 0; k < 24; ++k) {
        const double level = bank->pairs[k].level;
        for (j = k; j > 0 && (level < levels[j - 1] || (levels[j - 1] != levels[j - 1] && level == level)); --j) {
            levels[j] = levels[j - 1];
        }
        levels[j] = level;
    }
    return levels[12];
}

/* A scale on which the last pairs agree and that differs from the present one, with the nearest state of the bank;
 * returned once. 0 without one. */
static const trocar_state *trocar_better_than(trocar_bank *bank, double present, double *level)
{
    uint32_t first = 0xffffffffu, last = 0;
    double middle, change, part;
    int k, h, agreeing = 0;
    for (k = 0; k < 24; ++k) {
        if (!bank->pairs[k].is_known) {
            return 0;
        }
    }
    middle = trocar_median_level(bank);
    change = fabs(log(middle / present));
    if (!(change > 0.2)) {
        return 0;
    }
    for (k = 0; k < 24; ++k) {
        const trocar_pair *pair = &bank->pairs[k];
        agreeing += fabs(log(pair->level / middle)) < 0.12
                 && fabs(pair->load_n) < 3.0 * trocar_sigma_n + 0.12 * fabs(pair->turn_n);
        first = pair->stroke < first ? pair->stroke : first;
        last = pair->stroke > last ? pair->stroke : last;
    }
    if (agreeing + 4 < 24 || last - first + 1 < 3) {
        return 0;
    }
    trocar_forget_pairs(bank);
    h = trocar_place_of_level(middle, &part);
    *level = middle;
    return &bank->states[part < 0.5 ? h : h + 1];
}

//@end
/* The observer as a whole. */

static double trocar_present_level(const trocar_compensator *o)
{
//@if adapts
    return o->adapter.estimate[0];
//@else
    (void)o;
    return 1.0;
//@end
}

/* Half the range of the forces of the extreme states and the model. */
static double trocar_spread(const trocar_compensator *o)
{
    const double forces[3] = { trocar_seal_force(&o->extremes[0]), trocar_seal_force(&o->extremes[1]),
                               trocar_seal_force(&o->state) };
    double low = forces[0], high = forces[0];
    int k;
    for (k = 1; k < 3; ++k) {
        low = forces[k] < low ? forces[k] : low;
        high = forces[k] > high ? forces[k] : high;
    }
    return 0.5 * (high - low);
}

/* The state is unknown until the seal has slid. */
static void trocar_forget(trocar_compensator *o)
{
    trocar_rest_between(&o->extremes[0], -1.0);
    trocar_rest_between(&o->extremes[1], 1.0);
    o->are_apart = 1;
    trocar_break_off_sign(&o->sign);
//@if adapts
    trocar_break_off_adapter(&o->adapter);
    trocar_break_off_bank(&o->bank);
//@end
}

static void trocar_follow_model(trocar_compensator *o)
{
//@if stiff
    o->stiff = o->state;
//@else
    (void)o;
//@end
}

static void trocar_start(trocar_compensator *o, double position, double force)
{
//@if mass
    const double weight = trocar_moving_mass_kg * trocar_gravity_m_s2;
//@else
    const double weight = 0.0;
//@end
    const double reading = trocar_is_finite(force) ? force - trocar_sensor_offset_n - weight : 0.0;
    const double own = trocar_without_profile(position, reading);
    trocar_rest_with(&o->state, own);
    trocar_follow_model(o);
//@if adapts
    trocar_start_bank(&o->bank, own);
//@end
    o->position_m = position;
    o->has_position = 1;
    o->waited_s = 0.0;
//@if mass
    trocar_restart_inertia(&o->inertia, o->time, position);
//@end
    trocar_forget(o);
}

/* The position was redefined; the motion in between is unknown. */
static void trocar_rebase(trocar_compensator *o, double position)
{
    o->position_m = position;
//@if mass
    o->time = trocar_later(o->time, o->waited_s);
    trocar_restart_inertia(&o->inertia, o->time, position);
//@end
    o->waited_s = 0.0;
    trocar_forget(o);
}

//@if ems
static int trocar_all_slide(const trocar_state *state)
{
    int k, all = 1;
    for (k = 0; k < trocar_elements; ++k) {
        all = all && state->element[k].sliding;
    }
    return all;
}

/* Whether the deflection has turned since the seal last slid. */
static void trocar_take_turn(trocar_compensator *o)
{
    double deflection = -0.0, way;
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        deflection += o->state.element[k].deflection_m;
    }
    deflection /= (double)trocar_elements;
    way = deflection - o->turn_extreme_m;
    if (trocar_all_slide(&o->state)) {
        o->turn_extreme_m = deflection;
        o->turn_direction = 0.0;
        o->has_turned = 0;
    } else if (way * o->turn_direction > 0.0) {
        o->turn_extreme_m = deflection;
    } else if (fabs(way) > 0.02 * trocar_half_width_m) {
        o->has_turned = o->has_turned || o->turn_direction != 0.0;
        o->turn_extreme_m = deflection;
        o->turn_direction = way > 0.0 ? 1.0 : way < 0.0 ? -1.0 : 0.0;
    }
}

//@end
static void trocar_move_to(trocar_compensator *o, double position)
{
    const double displacement = position - o->position_m, duration = o->waited_s;
    const double level = trocar_present_level(o), own = displacement / level;
    int k;
    o->waited_s = 0.0;
    trocar_move_seal(&o->state, own, duration);
//@if ems
    trocar_take_turn(o);
//@end
//@if stiff
    trocar_move_elements(trocar_stiff_constants, &o->stiff, own, duration);
//@end
    if (o->are_apart) {
        for (k = 0; k < 2; ++k) {
            trocar_move_seal(&o->extremes[k], own, duration);
        }
        o->are_apart = !(trocar_spread(o) * level < 1e-3);
    }
    o->position_m = position;
    o->speed_m_s = displacement / duration;
    o->mean_speed_m_s += (1.0 - exp(-duration / 0.025)) * (o->speed_m_s - o->mean_speed_m_s);
//@if mass
    o->time = trocar_later(o->time, duration);
    trocar_advance_inertia(&o->inertia, o->time, position);
//@end
//@if adapts
    trocar_pass_time(&o->adapter, duration);
    trocar_advance_bank(&o->bank, displacement, duration);
//@end
}

/* All motion of a model without deflection is a slide. */
static int trocar_slides(const trocar_compensator *o)
{
//@if ems
    return trocar_all_slide(&o->state);
//@else
    (void)o;
    return 1;
//@end
}

/* Error of the model in the present phase of the motion. */
static double trocar_phase_error(const trocar_compensator *o)
{
    const int held = fabs(o->mean_speed_m_s) < 1e-3, deforms = !trocar_slides(o);
//@if ems
    const int turned = o->has_turned;
//@else
    const int turned = 0;
//@end
    if (held) {
        return trocar_phase_error_n[turned ? 4 : 3];
    }
    return trocar_phase_error_n[!deforms ? 2 : turned ? 1 : 0];
}

//@if adapts
static void trocar_learn(trocar_compensator *o, const trocar_slid *now, double variance)
{
    trocar_adapter *a = &o->adapter;
    const int inserts = o->speed_m_s > 0.0;
    const int slides = !o->are_apart && fabs(o->speed_m_s) >= 1e-3 && trocar_slides(o);
    const trocar_state *better;
    double level;
    if (trocar_settle(a, slides, inserts, o->position_m, 2.0 * trocar_half_width_m)) {
        trocar_take_slide(a, o->position_m, inserts, now);
    }
    if (!o->are_apart && o->speed_m_s != 0.0) {
        const double reading = now->reading_n - (a->estimate[1] - 1.0) * now->viscous_n;
        trocar_take_reading(&o->bank, o->position_m, inserts, reading, variance);
    }
    better = trocar_better_than(&o->bank, a->estimate[0], &level);
    if (better) {
        o->state = *better;
        trocar_follow_model(o);
        trocar_break_off_adapter(a);
        a->outliers = 0;
        a->estimate[0] = level < 0.1 ? 0.1 : level > 2.0 ? 2.0 : level;
        trocar_diagonal(a, 0.15 * 0.15, 0.3 * 0.3);
    }
}

//@end
/* Standard deviation of the force, without the doubt about the friction scale. */
static double trocar_force_std(const trocar_compensator *o, double sigma, double slope, double dry, double viscous,
                               double minor)
{
    const trocar_drift_estimate drift = trocar_drift(o);
    const double of_level = dry * drift.level_std, of_viscosity = viscous * drift.viscosity_std;
    const double spread = drift.level * (o->are_apart ? trocar_spread(o) : 0.0);
//@if adapts
    const double parameters = of_level * of_level + of_viscosity * of_viscosity
                            + 2.0 * dry * viscous * o->adapter.covariance[0][1];
    const double doubt = trocar_doubt(&o->bank, drift.level);
//@else
    const double parameters = of_level * of_level + of_viscosity * of_viscosity;
    const double doubt = 0.0;
//@end
    const double known = parameters > 0.0 ? parameters : 0.0;
    const double of_seal = known + spread * spread + minor * minor + doubt;
    return sqrt(sigma * sigma + slope * slope * of_seal);
}

static trocar_estimate trocar_estimated(trocar_compensator *o, double force, int fault)
{
    trocar_estimate e = o->last;
    const double level = trocar_present_level(o), position = o->position_m;
    const double viscosity = trocar_drift(o).viscosity;
    double sigma, slope, viscous, dry, own, own_dry, minor = 0.0;
    int is_spoilt;
    e.fault = fault;
    if (!o->has_position) {
        return e;
    }
    sigma = trocar_phase_error(o);
    slope = trocar_slope_at(position);
    viscous = level * trocar_viscous_force(&o->state, o->speed_m_s / level);
    dry = level * trocar_seal_force(&o->state) - viscous;
    e.@TROCAR_FORCE@ = trocar_along(position, dry + viscosity * viscous);
//@if mass
    own = force - trocar_sensor_offset_n - trocar_moving_mass_kg * (o->inertia.acceleration_m_s2 + trocar_gravity_m_s2);
//@else
    own = force - trocar_sensor_offset_n;
//@end
    is_spoilt = fault == trocar_NO_READING || fault == trocar_NO_POSITION || fault == trocar_SATURATED
             || fault == trocar_FROZEN;
    if (!is_spoilt && trocar_is_finite(own)) {
        if (!o->are_apart && trocar_slides(o) && o->speed_m_s * o->mean_speed_m_s > 0.0) {
            trocar_take_sign(&o->sign, position, o->speed_m_s > 0.0, trocar_without_profile(position, own),
                             trocar_seal_force(&o->state));
        }
        if (o->sign.is_opposite) {
            e.fault = trocar_OPPOSITE_SIGN;
            is_spoilt = 1;
        }
    }
    own_dry = dry / level;
//@if stiff
    minor = level * (0.5 * fabs(trocar_seal_force(&o->stiff) - trocar_seal_force(&o->state)));
//@end
    e.tissue_force_std_n = trocar_force_std(o, sigma, slope, own_dry, viscous, minor);
    e.tissue_force_n = is_spoilt ? (double)NAN : own - e.@TROCAR_FORCE@;
    e.adapting = 0;
//@if adapts
    if (!is_spoilt && trocar_is_finite(own)) {
        trocar_slid now;
        now.reading_n = trocar_without_profile(position, own);
        now.dry_n = own_dry;
        now.viscous_n = viscous;
        trocar_learn(o, &now, sigma / slope * (sigma / slope) + minor * minor);
    }
    e.adapting = trocar_is_adapting(&o->adapter);
//@end
    trocar_follow(&o->watch, e.@TROCAR_FORCE@, force);
    return e;
}

@LINKAGE@void trocar_reset(trocar_compensator *o)
{
    trocar_rest_with(&o->state, 0.0);
    trocar_follow_model(o);
    o->extremes[0] = o->extremes[1] = o->state;
    o->are_apart = o->has_position = 0;
    o->position_m = o->speed_m_s = o->mean_speed_m_s = o->waited_s = 0.0;
//@if ems
    o->turn_extreme_m = o->turn_direction = 0.0;
    o->has_turned = 0;
//@end
//@if mass
    o->time = trocar_time_zero();
    trocar_restart_inertia(&o->inertia, o->time, 0.0);
//@end
    o->watch.is_known = 0;
    o->watch.usual_s = 0.02;
    trocar_break_off_sign(&o->sign);
    o->sign.run = o->sign.is_opposite = 0;
//@if adapts
    trocar_reset_adapter(&o->adapter);
    trocar_start_bank(&o->bank, 0.0);
    o->bank.time = trocar_time_zero();
    o->bank.stroke = 0;
    o->bank.inserts = o->bank.inserted = 0;
    o->bank.samples = 0.0;
//@end
    o->last.@TROCAR_FORCE@ = 0.0;
    o->last.tissue_force_n = o->last.tissue_force_std_n = (double)NAN;
    o->last.adapting = 0;
    o->last.fault = trocar_NO_FAULT;
}

@LINKAGE@trocar_estimate trocar_compensate(trocar_compensator *o, double position_m, double reading_n, double duration_s)
{
//@if flips
    const double force = -reading_n;
//@else
    const double force = reading_n;
//@end
    const int goes_on = duration_s > 0.0 && trocar_is_finite(duration_s);
    double elapsed;
    int motion, reading;
    o->waited_s += goes_on ? duration_s : 0.0;
    elapsed = goes_on ? o->waited_s : duration_s;
    motion = trocar_motion_fault(o, position_m, elapsed);
    reading = trocar_reading_fault(&o->watch, force, elapsed);
    if (!o->has_position) {
        if (motion == trocar_NO_FAULT) {
            trocar_start(o, position_m, force);
        }
    } else if (motion == trocar_GAP) {
        trocar_move_to(o, position_m);
        trocar_forget(o);
    } else if (motion == trocar_JUMP) {
        trocar_rebase(o, position_m);
    } else if (motion == trocar_NO_FAULT && !(o->waited_s < 1e-5)) {
        trocar_move_to(o, position_m);
    }
    o->last = trocar_estimated(o, force, motion != trocar_NO_POSITION && reading ? reading : motion);
    return o->last;
}

@LINKAGE@trocar_drift_estimate trocar_drift(const trocar_compensator *o)
{
    trocar_drift_estimate drift;
//@if adapts
    drift.level = o->adapter.estimate[0];
    drift.viscosity = o->adapter.estimate[1];
    drift.level_std = sqrt(o->adapter.covariance[0][0]);
    drift.viscosity_std = sqrt(o->adapter.covariance[1][1]);
    drift.in_contact = o->adapter.contact;
//@else
    (void)o;
    drift.level = drift.viscosity = 1.0;
    drift.level_std = sqrt(trocar_prior[0]);
    drift.viscosity_std = sqrt(trocar_prior[1]);
    drift.in_contact = 0;
//@end
    return drift;
}
