static void trocar_step_element(const trocar_element *e, trocar_element_state *state, double velocity, double duration)
{
    trocar_element_state next = *state;
//@if mixed
    if (e->confined) {
        trocar_advance_confined(e, &next, velocity, duration);
    } else {
        trocar_advance_general(e, &next, velocity, duration);
    }
//@else
//@if confined
    trocar_advance_confined(e, &next, velocity, duration);
//@else
    trocar_advance_general(e, &next, velocity, duration);
//@end
//@end
    /* Unless a number grew beyond all bounds. */
    if (fabs(next.force_n) <= trocar_greatest && fabs(next.deflection_m) <= trocar_greatest) {
        *state = next;
    }
}

/* At rest without yield force. */
static void trocar_rest_element(const trocar_element *e, trocar_element_state *state, double deflection)
{
    double yield_force;
    const double force = trocar_reach(e, deflection, 0.0, deflection, &yield_force);
    trocar_stick(state, deflection, yield_force, force);
//@if arms
    state->arm_force_n[0] = 0.0;
    state->arm_force_n[1] = 0.0;
//@end
//@if dwell
    state->contact_age_s = 0.0;
//@end
//@if turning
    state->around_deflection_m = 0.0;
    state->around_slip_velocity_m_s = 0.0;
//@end
}

static void trocar_rest_elements(trocar_state *state)
{
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        trocar_rest_element(&trocar_element_constants[k], &state->element[k], 0.0);
    }
}

//@if compensator
/* M(z) less a force, at a cell boundary of 200 each way. */
static double trocar_excess(const trocar_element *e, double force, double z)
{
    double gap;
    return trocar_middle_and_gap(e, z, &gap) - force;
}

/* The deflection of least amount on the mid curve that holds a force; the nearer end beyond. */
static double trocar_deflection_at(const trocar_element *e, double force)
{
    const double c = e->half_width_m;
    double low = 0.0, high = 0.0;
    int n, side, found = 0;
    for (n = 0; n < 200 && !found; ++n) {
        for (side = 0; side < 2 && !found; ++side) {
            const double k = side ? (double)n : -1.0 - (double)n;
            low = c * k / 200.0;
            high = c * (k + 1.0) / 200.0;
            found = trocar_excess(e, force, low) * trocar_excess(e, force, high) <= 0.0;
        }
    }
    if (!found) {
        return force > 0.0 ? c : -c;
    }
    for (n = 0; n < 40; ++n) {
        const double middle = 0.5 * (low + high);
        if (trocar_excess(e, force, low) * trocar_excess(e, force, middle) <= 0.0) {
            high = middle;
        } else {
            low = middle;
        }
    }
    return 0.5 * (low + high);
}

/* At rest with a force, each element with the share of its static forces. */
static void trocar_rest_with(trocar_state *state, double force)
{
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        const trocar_element *e = &trocar_element_constants[k];
        const double own = force * trocar_static_force_n[k] / trocar_all_static_n;
        const double held = fabs(own) <= trocar_greatest ? own : 0.0;
        trocar_rest_element(e, &state->element[k], trocar_deflection_at(e, held));
    }
}

//@end
