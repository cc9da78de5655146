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

static void trocar_rest_seal(trocar_state *state)
{
    int k;
    for (k = 0; k < trocar_elements; ++k) {
        double yield_force;
        const double force = trocar_reach(&trocar_element_constants[k], 0.0, 0.0, 0.0, &yield_force);
        trocar_stick(&state->element[k], 0.0, yield_force, force);
//@if arms
        state->element[k].arm_force_n[0] = 0.0;
        state->element[k].arm_force_n[1] = 0.0;
//@end
    }
}

