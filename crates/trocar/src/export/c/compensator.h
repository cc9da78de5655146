
/* The observer of the force on the tissue, from a sensor outside the body: reading less offset, inertia and trocar force.
 *
 *     static trocar_compensator compensator;               large, hence static
 *     trocar_reset(&compensator);                          once
 *     e = trocar_compensate(&compensator, position, reading, duration); every sample; e.tissue_force_n
 *
 * A step never fails. The first sample starts the observer, whatever its duration.
 *
//@if flips
 * The reading has the sign that the sensor gives it: the observer reverses it, as the sign of the force was reversed for the
 * recordings of the model. Positive positions are insertion. */
//@else
 * The reading has the sign that the sensor gives it, which is that of the model: the force that the instrument exerts,
 * positive in the direction of insertion. Positive positions are insertion. */
//@end

/* What cannot be right about a sample. */
enum {
    trocar_NO_FAULT,
    trocar_NO_READING,  /* not a finite number: no tissue force, the model goes on */
    trocar_NO_POSITION, /* not a finite number: no tissue force, the model waits */
    trocar_NO_DURATION, /* not above 0 and finite: the model waits */
    trocar_SATURATED,   /* at the sensor's limit: no tissue force, it is larger */
    trocar_FROZEN,      /* constant although the force must have changed: no tissue force */
    trocar_JUMP,        /* the position moved faster than 1 m/s and by more than 1 mm: a new zero of the encoder */
    trocar_GAP,         /* more than 0.2 s: the state of the seal is unknown until it has slid */
    trocar_OPPOSITE_SIGN /* reading or position of the opposite sign over several strokes: no tissue force */
};

/* The estimate after a sample; forces are those of the instrument on what it touches. */
typedef struct {
    double @TROCAR_FORCE@;     /* on seal and trocar */
    double tissue_force_n;     /* on the tissue; NaN where the reading does not determine it */
    double tissue_force_std_n; /* standard deviation of both; NaN before the first position */
    int adapting; /* 1 while friction and viscosity are adapted, 0 in contact with tissue or without informative motion */
    int fault;    /* of this sample */
} trocar_estimate;

/* Friction and viscosity relative to those of the model. */
typedef struct {
    double level;         /* friction without its viscous part; wetting lowers it */
    double viscosity;     /* viscous part */
    double level_std;     /* standard deviations */
    double viscosity_std;
    int in_contact;       /* 1 if the last pair of crossings showed a load: tissue */
} trocar_drift_estimate;

/* The parts of the observer, which are its own matter. */

//@if clock
//@if single
/* A time of any length with the resolution of a short one. */
typedef struct {
    uint32_t whole_s;
    double rest_s;
} trocar_time;

//@else
typedef double trocar_time; /* s */

//@end
//@end
//@if mass
typedef struct {
    trocar_time time;
    double position_m;
} trocar_passed;

typedef struct {
    trocar_passed past[128];
    int next, count;
    double acceleration_m_s2;
} trocar_inertia;

//@end
typedef struct {
    int is_known;
    uint32_t samples;
    double reading_n, time_s, low_n, high_n, usual_s;
} trocar_watch;

typedef struct {
    int is_known, inserts;
    double from_m, reading_n, model_n;
} trocar_one_way;

typedef struct {
    trocar_one_way now, before;
    int run; /* reversals in succession with the sign of the model, negative against it */
    int is_opposite;
} trocar_sign_watch;

//@if adapts
typedef struct {
    double reading_n, dry_n, viscous_n;
} trocar_slid;

typedef struct {
    int32_t cell;
    int is_known;
    trocar_time time;
    trocar_slid mean;
} trocar_crossing;

typedef struct {
    double estimate[2], covariance[2][2];
    trocar_crossing memory[2][512]; /* withdrawal, insertion */
    int is_crossing, inserts;
    int32_t cell;
    trocar_slid sum;
    double samples;
    int is_sliding, slide_inserts;
    double slide_from_m;
    int has_learnt, contact, has_load;
    trocar_time time, learnt, loaded;
    uint32_t outliers;
} trocar_adapter;

typedef struct {
    int32_t cell;
    int is_known;
    trocar_time time;
    double reading_n, variance_n2, forces_n[7];
} trocar_bank_crossing;

typedef struct {
    int is_known;
    uint32_t stroke;
    double level, load_n, turn_n, turns_n[7], variance_n2;
} trocar_pair;

typedef struct {
    trocar_state states[7];
    trocar_bank_crossing memory[2][512];
    trocar_bank_crossing current; /* sums */
    int inserts, inserted;
    double samples;
    trocar_pair pairs[24];
    int next;
    uint32_t stroke;
    trocar_time time;
} trocar_bank;

//@end
typedef struct {
    trocar_state state; /* driven by the displacement over the friction scale */
    trocar_state extremes[2];
    int are_apart; /* the extreme states still differ */
//@if stiff
    trocar_state stiff; /* with the stiffest law between the branches */
//@end
    int has_position;
    double position_m, speed_m_s, mean_speed_m_s;
//@if ems
    double turn_extreme_m, turn_direction;
    int has_turned;
//@end
    double waited_s;
//@if mass
    trocar_time time;
    trocar_inertia inertia;
//@end
    trocar_watch watch;
    trocar_sign_watch sign;
//@if adapts
    trocar_adapter adapter;
    trocar_bank bank;
//@end
    trocar_estimate last;
} trocar_compensator;

/* Starts anew with the next sample. */
@LINKAGE@void trocar_reset(trocar_compensator *compensator);

/* The next sample: position, reading of the force sensor with its own sign, duration_s after the last one. */
@LINKAGE@trocar_estimate trocar_compensate(trocar_compensator *compensator, double position_m, double reading_n,
                                  double duration_s);

/* Where friction and viscosity stand. */
@LINKAGE@trocar_drift_estimate trocar_drift(const trocar_compensator *compensator);
