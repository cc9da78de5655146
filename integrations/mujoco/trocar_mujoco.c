/*
 * A trocar as a passive force on a slide joint of MuJoCo: the engine plugin "trocar".
 *
 * Every number that changes is in mjData.plugin_state, so the engine copies, saves and resets it. What does not change, the
 * model and the joint, is one block behind mjData.plugin_data, shared by all copies of an mjData and never written again.
 *
 * The force of a step is that at its end, found before the engine takes the step, for MuJoCo does not differentiate plugins.
 * With the joint at x moving at v, the mobility w of the joint ((M^-1)_ii, 1/kg), and the acceleration a that all other forces
 * gave in the step before, the end y of a step h and the force f on the seal satisfy
 *
 *     y = x + h v + h^2 (a - w f),   f = F(seal, y, h),
 *
 * with F the step of the model from the seal's stored state (implicit Euler). Once the engine has taken the step, the seal
 * follows to where the joint really is.
 *
 * A model with rotation may also turn with a hinge joint about the same axis. Its angle and torque satisfy the same equation,
 * and the two are solved in turn, each with the end of the other, until neither changes.
 *
 * Licence: MIT OR Apache-2.0.
 */
#include <math.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <mujoco/mujoco.h>
#include <trocar.h>

_Static_assert(sizeof(mjtNum) == sizeof(double), "a MuJoCo of double precision");

#define PLUGIN "trocar"

/* What never changes: shared by all copies of an mjData. */
typedef struct {
    atomic_size_t users;
    trocar_model *model;
    int joint;
    int axes;        /* 1, or 2 with a hinge joint */
    int position[2]; /* index in qpos: of the slide joint, and of the hinge joint */
    int dof[2];      /* index in qvel */
} trocar_instance;

/* When a seal begins: at rest where the joint is as the first step begins. */
enum phase { PHASE_UNSET, PHASE_AT_REST, PHASE_RUNNING };

/* What changes, in mjData.plugin_state; all zero after a reset. */
typedef struct {
    double phase;
    double seal[TROCAR_STATE_NUMBERS]; /* trocar_state_save(), at the end of the last step */
    double from_rad;                   /* angle of the hinge joint where the seal began */
    double seal_load[2];               /* its force, N, and torque, N m, where the joints are */
    double other[2];                   /* acceleration by all other forces in the last step, m/s^2 and rad/s^2 */
    double load[2];                    /* on the seal, in the step under way */
    double open;                       /* 1 from the force of a step to its end; the next three belong to it */
    double time_s;
    double velocity[2];
    double mobility[2];
    double reported; /* trocar_status that was reported; 0 once a step has ended well */
} trocar_slots;

enum { SLOTS = sizeof(trocar_slots) / sizeof(double) };

static const trocar_instance *shared(const mjData *d, int instance)
{
    return (const trocar_instance *)d->plugin_data[instance];
}

static trocar_slots *slots_of(const mjModel *m, mjData *d, int instance)
{
    return (trocar_slots *)(d->plugin_state + m->plugin_stateadr[instance]);
}

static const char *instance_name(const mjModel *m, int instance)
{
    const char *name = mj_id2name(m, mjOBJ_PLUGIN, instance);
    return name != NULL ? name : "(unnamed)";
}

/* ---- life of an instance ---- */

static int nstate(const mjModel *m, int instance)
{
    (void)m, (void)instance;
    return SLOTS;
}

static void release(mjData *d, int instance)
{
    trocar_instance *block = (trocar_instance *)d->plugin_data[instance];
    d->plugin_data[instance] = 0;
    if (block != NULL && atomic_fetch_sub(&block->users, 1) == 1) {
        trocar_model_free(block->model);
        free(block);
    }
}

static void share(mjData *to, const mjModel *m, const mjData *from, int instance)
{
    trocar_instance *block = (trocar_instance *)from->plugin_data[instance];
    (void)m;
    if (block != NULL) {
        atomic_fetch_add(&block->users, 1);
    }
    release(to, instance);
    to->plugin_data[instance] = (uintptr_t)block;
}

/* The slide joint of an instance, or -1 with a warning. */
static int find_joint(const mjModel *m, int instance)
{
    const char *name = mj_getPluginConfig(m, instance, "joint");
    int joint;
    int other;

    if (name == NULL || *name == '\0') {
        mju_warning(PLUGIN " '%s': no joint given, expected <config key=\"joint\" value=\"NAME\"/>",
                    instance_name(m, instance));
        return -1;
    }
    joint = mj_name2id(m, mjOBJ_JOINT, name);
    if (joint < 0) {
        mju_warning(PLUGIN " '%s': no joint '%s' in the model", instance_name(m, instance), name);
        return -1;
    }
    if (m->jnt_type[joint] != mjJNT_SLIDE) {
        mju_warning(PLUGIN " '%s': joint '%s' is no slide joint; a trocar acts along an axis",
                    instance_name(m, instance), name);
        return -1;
    }
    for (other = 0; other < instance; other++) {
        if (m->plugin[other] == m->plugin[instance] && strcmp(mj_getPluginConfig(m, other, "joint"), name) == 0) {
            mju_warning(PLUGIN " '%s': joint '%s' already has the trocar '%s'; one joint takes one",
                        instance_name(m, instance), name, instance_name(m, other));
            return -1;
        }
    }
    return joint;
}

/* The hinge joint that an instance turns with, -1 for none, or -2 with a warning. */
static int find_hinge(const mjModel *m, int instance, int slide)
{
    const char *name = mj_getPluginConfig(m, instance, "hinge");
    const int joint = name == NULL || *name == '\0' ? -1 : mj_name2id(m, mjOBJ_JOINT, name);

    if (name == NULL || *name == '\0') {
        return -1;
    }
    if (joint < 0) {
        mju_warning(PLUGIN " '%s': no joint '%s' in the model", instance_name(m, instance), name);
        return -2;
    }
    if (m->jnt_type[joint] != mjJNT_HINGE || m->jnt_bodyid[joint] != m->jnt_bodyid[slide]) {
        mju_warning(PLUGIN " '%s': joint '%s' is no hinge joint of the body of joint '%s'", instance_name(m, instance), name,
                    mj_id2name(m, mjOBJ_JOINT, slide));
        return -2;
    }
    return joint;
}

/* Whether a model resists rotation. */
static int turns(const trocar_model *model)
{
    double force_n;
    trocar_state seal;

    return trocar_state_init(model, &seal, 0.0) == TROCAR_STATUS_OK &&
           trocar_turn_to(model, &seal, 0.0, 0.0, 1.0, &force_n) == TROCAR_STATUS_OK;
}

/* The model of an instance, or NULL with a warning. */
static trocar_model *load_model(const mjModel *m, int instance, int has_hinge)
{
    const char *path = mj_getPluginConfig(m, instance, "model");
    char message[TROCAR_MESSAGE_SIZE];
    trocar_model *model = NULL;

    if (path == NULL || *path == '\0') {
        mju_warning(PLUGIN " '%s': no model file given, expected <config key=\"model\" value=\"model.json\"/>",
                    instance_name(m, instance));
    } else if (trocar_model_load(path, &model, message, sizeof message) != TROCAR_STATUS_OK) {
        mju_warning(PLUGIN " '%s': %s", instance_name(m, instance), message);
    } else if (has_hinge && !turns(model)) {
        mju_warning(PLUGIN " '%s': a hinge joint is given, but %s has no 'rotation': leave the key hinge out",
                    instance_name(m, instance), path);
        trocar_model_free(model);
        model = NULL;
    }
    return model;
}

static int init(const mjModel *m, mjData *d, int instance)
{
    const int joint = find_joint(m, instance);
    const int hinge = joint < 0 ? -2 : find_hinge(m, instance, joint);
    trocar_model *model = hinge == -2 ? NULL : load_model(m, instance, hinge >= 0);
    trocar_instance *block = model == NULL ? NULL : malloc(sizeof *block);

    d->plugin_data[instance] = 0;
    if (block == NULL) {
        trocar_model_free(model);
        return -1;
    }
    atomic_init(&block->users, 1);
    block->model = model;
    block->joint = joint;
    block->axes = hinge >= 0 ? 2 : 1;
    block->position[0] = m->jnt_qposadr[joint];
    block->dof[0] = m->jnt_dofadr[joint];
    if (hinge >= 0) {
        block->position[1] = m->jnt_qposadr[hinge];
        block->dof[1] = m->jnt_dofadr[hinge];
    }
    d->plugin_data[instance] = (uintptr_t)block;
    return 0;
}

static void reset(const mjModel *m, mjtNum *plugin_state, void *plugin_data, int instance)
{
    (void)m, (void)plugin_data, (void)instance;
    memset(plugin_state, 0, sizeof(trocar_slots));
}

/* ---- the seal ---- */

/* Reports what was refused, once until a step ends well; the last good state and force stay. */
static void report(const mjModel *m, const mjData *d, int instance, trocar_slots *slots, trocar_status status)
{
    const trocar_instance *block = shared(d, instance);

    if (slots->reported != status) {
        mju_warning(PLUGIN " '%s': time %g s, joint '%s' at %g m, %g m/s, timestep %g s: %s; "
                    "the seal keeps its state and the force %g N",
                    instance_name(m, instance), d->time, mj_id2name(m, mjOBJ_JOINT, block->joint),
                    d->qpos[block->position[0]], d->qvel[block->dof[0]], m->opt.timestep, trocar_status_message(status),
                    slots->load[0]);
        slots->reported = status;
    }
}

/* Puts an undeformed seal at rest where the joint is. */
static trocar_status begin(const mjData *d, int instance, trocar_slots *slots)
{
    const trocar_instance *block = shared(d, instance);
    trocar_state seal;
    const trocar_status status = trocar_state_init(block->model, &seal, d->qpos[block->position[0]]);

    if (status != TROCAR_STATUS_OK) {
        return status;
    }
    slots->phase = PHASE_AT_REST;
    slots->from_rad = block->axes > 1 ? d->qpos[block->position[1]] : 0.0;
    trocar_state_force(&seal, &slots->seal_load[0]);
    slots->seal_load[1] = 0.0;
    return trocar_state_save(&seal, slots->seal, TROCAR_STATE_NUMBERS);
}

static trocar_status stored_seal(const mjData *d, int instance, const trocar_slots *slots, trocar_state *seal)
{
    return trocar_state_restore(shared(d, instance)->model, seal, slots->seal, TROCAR_STATE_NUMBERS, NULL, 0);
}

/* Moves a seal to a position and, where it turns, to an angle from where it began; gives force and torque. */
static trocar_status move_to(const trocar_instance *block, trocar_state *seal, const double at[2], double duration_s,
                             double load[2])
{
    trocar_status status;

    if (block->axes == 1) {
        return trocar_step_to(block->model, seal, at[0], duration_s, &load[0]);
    }
    status = trocar_turn_to(block->model, seal, at[0], at[1], duration_s, &load[0]);
    return status == TROCAR_STATUS_OK ? trocar_state_torque(block->model, seal, &load[1]) : status;
}

/* Where a step ends, by the force that acts in it. With a hinge joint the same for the angle (rad) and the torque (N m), each
 * with the end of the other as it is. */
typedef struct {
    const trocar_instance *block;
    const trocar_state *seal;
    double duration_s;
    int axis;              /* 0: position and force are sought, 1: angle and torque */
    double at[2];          /* the end so far */
    double free_m;         /* where the joint gets without the trocar */
    double compliance_m_n; /* how much each newton on the seal takes off that: h^2 w */
    trocar_status status;
} step_end;

/* A possible end: the force of the seal there, and how much farther it is than that force lets the joint get. */
typedef struct {
    double position_m;
    double force_n;
    double excess_m;
} trial;

/* Tries an end; the stored seal stays as it is. */
static trial try_end(step_end *end, double position_m)
{
    trocar_state seal = *end->seal;
    trial tried = {position_m, 0.0, 0.0};
    double at[2] = {end->at[0], end->at[1]}, load[2] = {0.0, 0.0};
    trocar_status status;

    at[end->axis] = position_m;
    status = move_to(end->block, &seal, at, end->duration_s, load);
    tried.force_n = load[end->axis];
    if (status != TROCAR_STATUS_OK) {
        end->status = status;
    }
    tried.excess_m = position_m - end->free_m + end->compliance_m_n * tried.force_n;
    return tried;
}

/* Ends whose forces differ by less are the same, N. */
static const double FORCE_ERROR_N = 1e-10;

/* The force where the excess changes sign, by Ridders' method: the ends at least halve their distance each round, also at a
 * jump of the force. There (static friction at rest) the force is the one that stops the joint. */
static double force_between(step_end *end, trial below, trial above)
{
    const double enough_m = end->compliance_m_n * FORCE_ERROR_N;
    double balance_n;

    while (end->status == TROCAR_STATUS_OK && above.position_m - below.position_m > enough_m) {
        const double half_m = 0.5 * (above.position_m - below.position_m);
        const trial middle = try_end(end, below.position_m + half_m);
        const double scale_m = sqrt(middle.excess_m * middle.excess_m - below.excess_m * above.excess_m);
        trial next;
        if (middle.position_m <= below.position_m || middle.position_m >= above.position_m) {
            break; /* neighbouring numbers */
        }
        if (fabs(middle.excess_m) <= enough_m) {
            return middle.force_n;
        }
        *(middle.excess_m < 0.0 ? &below : &above) = middle;
        next = try_end(end, middle.position_m - half_m * middle.excess_m / scale_m);
        if (fabs(next.excess_m) <= enough_m) {
            return next.force_n;
        }
        *(next.excess_m < 0.0 ? &below : &above) = next;
    }
    balance_n = (end->free_m - 0.5 * (below.position_m + above.position_m)) / end->compliance_m_n;
    return fmax(fmin(below.force_n, above.force_n), fmin(fmax(below.force_n, above.force_n), balance_n));
}

/* The force on the seal that is that of the seal where it lets the joint get. */
static double force_of_step(step_end *end)
{
    const trial free = try_end(end, end->free_m);
    double reach_m = -free.excess_m;
    trial other = free;

    /* Where the force falls with the speed, it can be larger at the nearer end: then look farther. It is bounded. */
    do {
        if (end->status != TROCAR_STATUS_OK || end->free_m + reach_m == end->free_m) {
            return free.force_n; /* refused; or a joint that this force does not move: its end is known */
        }
        other = try_end(end, end->free_m + reach_m);
        reach_m *= 2.0;
    } while ((other.excess_m < 0.0) == (free.excess_m < 0.0) && other.excess_m != 0.0);
    return free.excess_m > 0.0 ? force_between(end, other, free) : force_between(end, free, other);
}

/* Rounds in which force and torque settle. A round brings them nearer the more inertia the joints have. */
enum { ROUNDS = 100 };

/* Force and torque on the seal: in a step that ends, without the trocar, at `free`. */
static void loads_of_step(step_end *end, int axes, const double free[2], const double compliance[2], double load[2])
{
    int round;
    double last[2] = {HUGE_VAL, HUGE_VAL};

    for (round = 0; round < ROUNDS && end->status == TROCAR_STATUS_OK; round++) {
        for (end->axis = 0; end->axis < axes; end->axis++) {
            end->free_m = free[end->axis];
            end->compliance_m_n = compliance[end->axis];
            load[end->axis] = force_of_step(end);
            end->at[end->axis] = end->free_m - end->compliance_m_n * load[end->axis];
        }
        if (axes == 1 || (fabs(load[0] - last[0]) <= FORCE_ERROR_N && fabs(load[1] - last[1]) <= FORCE_ERROR_N)) {
            return;
        }
        last[0] = load[0], last[1] = load[1];
    }
}

/* Acceleration of a dof by a unit force on it, 1/kg. */
static double mobility(const mjModel *m, mjData *d, int dof)
{
    mjtNum *unit;
    mjtNum *acceleration;
    double result;

    mj_markStack(d);
    unit = mj_stackAllocNum(d, (size_t)m->nv);
    acceleration = mj_stackAllocNum(d, (size_t)m->nv);
    mju_zero(unit, m->nv);
    unit[dof] = 1.0;
    mj_solveM(m, d, acceleration, unit, 1);
    result = acceleration[dof];
    mj_freeStack(d);
    return result;
}

/* Finds the force of the step that begins here. */
static trocar_status open_step(const mjModel *m, mjData *d, int instance, trocar_slots *slots)
{
    const trocar_instance *block = shared(d, instance);
    const double step_s = m->opt.timestep;
    double load[2] = {0.0, 0.0}, free[2] = {0.0, 0.0}, compliance[2] = {0.0, 0.0}, velocity[2], mobilities[2];
    trocar_state seal;
    trocar_status status = slots->phase == PHASE_RUNNING ? TROCAR_STATUS_OK : begin(d, instance, slots);
    step_end end = {block, &seal, step_s, 0, {0.0, 0.0}, 0.0, 0.0, TROCAR_STATUS_OK};
    int axis;

    slots->open = 0.0;
    if (status == TROCAR_STATUS_OK) {
        status = stored_seal(d, instance, slots, &seal);
    }
    if (status != TROCAR_STATUS_OK) {
        return status;
    }
    for (axis = 0; axis < block->axes; axis++) {
        velocity[axis] = d->qvel[block->dof[axis]];
        mobilities[axis] = mobility(m, d, block->dof[axis]);
        free[axis] = d->qpos[block->position[axis]] - (axis == 1 ? slots->from_rad : 0.0);
        free[axis] += step_s * velocity[axis];
        free[axis] += step_s * step_s * slots->other[axis];
        compliance[axis] = step_s * step_s * mobilities[axis];
        end.at[axis] = free[axis];
    }
    loads_of_step(&end, block->axes, free, compliance, load);
    if (end.status != TROCAR_STATUS_OK) {
        return end.status;
    }
    slots->open = 1.0;
    slots->time_s = d->time;
    for (axis = 0; axis < block->axes; axis++) {
        slots->velocity[axis] = velocity[axis];
        slots->mobility[axis] = mobilities[axis];
        slots->load[axis] = load[axis];
    }
    return TROCAR_STATUS_OK;
}

/* Whether this is a later stage of a Runge-Kutta step: it has the force with which the step began. */
static int later_stage(const mjModel *m, const mjData *d, const trocar_slots *slots)
{
    const double step_s = m->opt.timestep;

    return m->opt.integrator == mjINT_RK4 && slots->open != 0.0 &&
           (d->time == slots->time_s + 0.5 * step_s || d->time == slots->time_s + step_s);
}

/* ---- what the engine calls ---- */

/* A sensor reads the force, and with a hinge joint the torque. */
static int nsensordata(const mjModel *m, int instance, int sensor)
{
    const char *hinge = mj_getPluginConfig(m, instance, "hinge");

    (void)sensor;
    return hinge == NULL || *hinge == '\0' ? 1 : 2;
}

/* A sensor of the instance reads what the seal takes where the joints are. */
static void write_sensors(const mjModel *m, mjData *d, int instance)
{
    const trocar_slots *slots = slots_of(m, d, instance);
    int sensor;

    for (sensor = 0; sensor < m->nsensor; sensor++) {
        if (m->sensor_type[sensor] == mjSENS_PLUGIN && m->sensor_plugin[sensor] == instance) {
            mju_copy(d->sensordata + m->sensor_adr[sensor], slots->seal_load, shared(d, instance)->axes);
        }
    }
}

static void compute(const mjModel *m, mjData *d, int instance, int capability)
{
    const trocar_instance *block = shared(d, instance);
    trocar_slots *slots = slots_of(m, d, instance);
    int axis;

    if (capability == mjPLUGIN_SENSOR) {
        write_sensors(m, d, instance);
        return;
    }
    if (!later_stage(m, d, slots)) {
        const trocar_status status = open_step(m, d, instance, slots);
        if (status != TROCAR_STATUS_OK) {
            report(m, d, instance, slots, status);
        }
    }
    for (axis = 0; axis < block->axes; axis++) {
        d->qfrc_passive[block->dof[axis]] -= slots->load[axis];
    }
}

/* The step is taken: the seal follows to where the joint is. */
static void advance(const mjModel *m, mjData *d, int instance)
{
    const trocar_instance *block = shared(d, instance);
    const double step_s = m->opt.timestep;
    trocar_slots *slots = slots_of(m, d, instance);
    trocar_state seal;
    double load[2] = {0.0, 0.0}, at[2] = {0.0, 0.0};
    int axis;
    trocar_status status = slots->phase == PHASE_UNSET ? begin(d, instance, slots) : TROCAR_STATUS_OK;

    if (status == TROCAR_STATUS_OK) {
        status = stored_seal(d, instance, slots, &seal);
    }
    for (axis = 0; axis < block->axes; axis++) {
        at[axis] = d->qpos[block->position[axis]] - (axis == 1 ? slots->from_rad : 0.0);
    }
    if (status == TROCAR_STATUS_OK) {
        status = move_to(block, &seal, at, step_s, load);
    }
    if (status != TROCAR_STATUS_OK) {
        report(m, d, instance, slots, status);
    } else {
        trocar_state_save(&seal, slots->seal, TROCAR_STATE_NUMBERS);
        mju_copy(slots->seal_load, load, 2);
        slots->phase = PHASE_RUNNING;
        slots->reported = TROCAR_STATUS_OK;
    }
    for (axis = 0; axis < block->axes; axis++) {
        slots->other[axis] = 0.0;
        if (slots->open != 0.0 && status == TROCAR_STATUS_OK) {
            const double gained = (d->qvel[block->dof[axis]] - slots->velocity[axis]) / step_s;
            const double other = gained + slots->mobility[axis] * slots->load[axis];
            slots->other[axis] = isfinite(other) ? other : 0.0;
        }
    }
    slots->open = 0.0;
}

mjPLUGIN_LIB_INIT(trocar)
{
    static const char *const attributes[] = {"model", "joint", "hinge"};
    mjpPlugin plugin;

    /* The layout of mjModel and mjData is that of the header. */
    if (mj_version() != mjVERSION_HEADER) {
        mju_warning(PLUGIN ": built with the headers of MuJoCo %d, loaded into %d (%s): not registered; build it again with "
                    "the headers of the MuJoCo that loads it", mjVERSION_HEADER, mj_version(), mj_versionString());
        return;
    }
    mjp_defaultPlugin(&plugin);
    plugin.name = PLUGIN;
    plugin.nattribute = sizeof attributes / sizeof *attributes;
    plugin.attributes = attributes;
    plugin.capabilityflags = mjPLUGIN_PASSIVE | mjPLUGIN_SENSOR;
    plugin.needstage = mjSTAGE_VEL;
    plugin.nstate = nstate;
    plugin.nsensordata = nsensordata;
    plugin.init = init;
    plugin.destroy = release;
    plugin.copy = share;
    plugin.reset = reset;
    plugin.compute = compute;
    plugin.advance = advance;
    mjp_registerPlugin(&plugin);
}
