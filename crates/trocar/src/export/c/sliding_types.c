/* Sliding friction, EMS (11). */
typedef struct {
    double coulomb_force_n; /* F_c */
//@if static_force
    double static_force_n; /* F_s */
//@end
    double viscous_damping_n_s_m; /* beta */
//@if stribeck
    double surplus_force_n;               /* F_s - F_c */
    double inverse_stribeck_velocity_s_m; /* 1/v_s */
    double stribeck_exponent;             /* delta */
//@end
} trocar_contact;

