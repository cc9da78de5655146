//@state
    double element_deflection_m[@ELEMENTS@]; /* z_i */
    int element_slips[@ELEMENTS@];
    double direction;    /* sgn(v) of the last step */
    double seal_force_n; /* of the seal alone */
//@code
static void trocar_rest_with(trocar_state *state, double force)
{
    const double held = trocar_held(force, trocar_sliding.static_force_n);
    int i;
    state->direction = 0.0;
    state->seal_force_n = -0.0;
    for (i = 0; i < trocar_elements; ++i) {
        state->element_deflection_m[i] = trocar_scale_m_n[i] * held;
        state->element_slips[i] = 0;
        state->seal_force_n += trocar_stiffness_n_m[i] * state->element_deflection_m[i];
    }
}

/* The motion of one step, as all elements see it. */
typedef struct {
    double sign, speed, travel, duration;
    double fastest;              /* bound of |dz_i/dt| in slip, m/s */
    double level, inverse_level; /* g(|v|), N, and its inverse */
    double faded_rate, fade;     /* the last rate over the whole step, 1/s, and what it leaves */
} trocar_drive;

/* Distance (m) from the limit after a step in slip, EMS (5); *rate becomes the speed (m/s) at which it then shrinks. */
static double trocar_relax(double distance, double *rate, trocar_drive *drive)
{
    const double linear = distance - drive->fastest / *rate;
    double left;
    if (linear > 0.0) {
        if (drive->travel <= linear) {
            *rate = drive->fastest;
            return distance - drive->travel;
        }
        left = (distance - linear) * trocar_decay((drive->duration - linear / drive->fastest) * *rate);
    } else {
        if (*rate != drive->faded_rate) {
            drive->faded_rate = *rate;
            drive->fade = trocar_decay(drive->duration * *rate);
        }
        left = distance * drive->fade;
    }
    *rate = left * *rate;
    return left;
}

/* Moves one element with limit nu*g = limit (m) and C/nu = rate (N/s); returns dz/dt (m/s) at the end. */
static double trocar_move(double *z, int *slips, double limit, double rate, trocar_drive *drive)
{
    const double s = drive->sign, u = s * *z;
    double distance, left, speed;
    if (!*slips && u < limit) {
        const double moved = u + drive->travel; /* EMS (5), stick */
        *slips = moved >= limit;
        *z = s * (*slips ? limit : moved);
        return *slips ? 0.0 : s * drive->speed;
    }
    *slips = 1;
    distance = limit - u;
    if (distance == 0.0) {
        return 0.0;
    }
    speed = rate * drive->inverse_level;
    left = trocar_relax(fabs(distance), &speed, drive);
    if (distance < 0.0) {
        left = -left;
        speed = -speed;
    }
    *z = s * (limit - left);
    return s * speed;
}

/* EMS (5) to (7). */
static void trocar_step_seal(trocar_state *state, double velocity, double displacement, double duration)
{
    const double s = trocar_sign(velocity);
    trocar_drive drive;
    double force = s == 0.0 ? -0.0 : trocar_sliding.viscous_damping_n_s_m * velocity;
    int i;
    if (!(trocar_slip_bound_n + trocar_damping_n_s_m * fabs(velocity) <= trocar_greatest)) {
        return;
    }
    drive.sign = s;
    drive.speed = fabs(velocity);
    drive.travel = fabs(displacement);
    drive.duration = duration;
//@if limited
    drive.fastest = drive.speed;
//@else
    drive.fastest = HUGE_VAL;
//@end
    drive.level = trocar_level(&trocar_sliding, drive.speed);
    drive.inverse_level = 1.0 / drive.level;
    drive.faded_rate = 0.0;
    drive.fade = 1.0;
    for (i = 0; i < trocar_elements; ++i) {
        double *z = &state->element_deflection_m[i];
        if (s != state->direction) {
            state->element_slips[i] = 0;
        }
        if (s == 0.0) {
            force += trocar_stiffness_n_m[i] * *z;
        } else {
            const double rate = trocar_move(z, &state->element_slips[i], trocar_scale_m_n[i] * drive.level,
                                            trocar_rate_n_s[i], &drive);
            force += trocar_stiffness_n_m[i] * *z + trocar_element_damping_n_s_m[i] * rate; /* EMS (7) */
        }
    }
    state->direction = s;
    state->seal_force_n = force;
}

