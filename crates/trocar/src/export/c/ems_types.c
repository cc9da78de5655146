/* The middle M and half the gap h of the two branches over one span between their joins, EMS (25): power series of
 * t in [-1, 1]. */
typedef struct {
    double middle_m, inverse_half_1_m;
    double force_n[@TERMS@][2]; /* M, h */
//@if general
    double slope_n_m[@TERMS@][2]; /* dM/dz, dh/dz */
//@end
} trocar_span;

/* What is known of sliding to one side. */
typedef struct {
//@if confined
    double end_force_n;       /* |F_e| where the seal begins to slide */
    double end_stiffness_n_m; /* K beyond */
    double rate_1_s;          /* K/beta */
    double lag_s;             /* beta/K */
//@end
//@if general
    double coulomb_force_n;        /* F_c */
    double static_force_n;         /* F_s */
    double viscous_damping_n_s_m;  /* beta */
    double least_damping_n_s_m;    /* beta + min dD/dz' */
    int force_is_free;             /* neither beta nor sigma: the force does not decide the slip speed */
//@if stribeck
    double surplus_force_n;              /* F_s - F_c */
    double stribeck_velocity_m_s;        /* v_s */
    double inverse_stribeck_velocity_s_m;
    double stribeck_exponent;            /* delta */
    double steepest_fall_n_s_m;          /* max|g'| */
    int velocity_weakening;              /* one force may belong to several slip speeds */
//@else
//@if turning
    double stribeck_velocity_m_s; /* v_s */
//@end
//@end
//@end
} trocar_contact;

/* One element. */
typedef struct {
    double half_width_m;        /* c */
    double yield_stiffness_n_m; /* kappa */
    double joins_m[2];
    trocar_span span[3];
    double end_force_n[2];       /* F_e at -c and c */
    double end_stiffness_n_m[2]; /* dF_e/dz beyond */
    trocar_contact contact[2];   /* withdrawal, insertion */
//@if general
    double least_stiffness_n_m; /* smallest dF_e/dz */
//@end
//@if damping
    double seal_damping[3]; /* sigma = s_0 + s_1*|z'| + s_2*z'^2, EMS (9) */
//@end
//@if creep
    double creep_velocity_m_s; /* v_c */
//@end
//@if lag
    double friction_lag_s; /* T */
//@end
//@if dwell
    double dwell_force_n; /* Delta F */
//@end
//@if arms
    double arm_stiffness_n_m[2]; /* E */
    double arm_time_s[2];        /* tau */
//@end
//@if turning
    double around_stiffness_n_m; /* k_t, its part of it */
    trocar_contact around;       /* around the shaft; friction alone */
//@end
//@if mixed
    int confined; /* slides on the straight ends only, without damping: the step is exact */
//@end
} trocar_element;

