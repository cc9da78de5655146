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
    int position; /* index in qpos */
    int dof;      /* index in qvel */
} trocar_instance;

/* When a seal begins: at rest where the joint is as the first step begins. */
enum phase { PHASE_UNSET, PHASE_AT_REST, PHASE_RUNNING };

/* What changes, in mjData.plugin_state; all zero after a reset. */
typedef struct {
    double phase;
    double seal[TROCAR_STATE_NUMBERS]; /* trocar_state_save(), at the end of the last step */
    double seal_force_n;               /* its force, where the joint is */
    double other_m_s2;                 /* acceleration by all other forces in the last step */
    double force_n;                    /* on the seal, in the step under way */
    double open;                       /* 1 from the force of a step to its end; the next three belong to it */
    double time_s;
    double velocity_m_s;
    double mobility_per_kg;
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

/* The model of an instance, or NULL with a warning. */
static trocar_model *load_model(const mjModel *m, int instance)
{
    const char *path = mj_getPluginConfig(m, instance, "model");
    char message[TROCAR_MESSAGE_SIZE];
    trocar_model *model = NULL;

    if (path == NULL || *path == '\0') {
        mju_warning(PLUGIN " '%s': no model file given, expected <config key=\"model\" value=\"model.json\"/>",
                    instance_name(m, instance));
    } else if (trocar_model_load(path, &model, message, sizeof message) != TROCAR_STATUS_OK) {
        mju_warning(PLUGIN " '%s': %s", instance_name(m, instance), message);
    }
    return model;
}

static int init(const mjModel *m, mjData *d, int instance)
{
    const int joint = find_joint(m, instance);
    trocar_model *model = joint < 0 ? NULL : load_model(m, instance);
    trocar_instance *block = model == NULL ? NULL : malloc(sizeof *block);

    d->plugin_data[instance] = 0;
    if (block == NULL) {
        trocar_model_free(model);
        return -1;
    }
    atomic_init(&block->users, 1);
    block->model = model;
    block->joint = joint;
    block->position = m->jnt_qposadr[joint];
    block->dof = m->jnt_dofadr[joint];
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
                    d->qpos[block->position], d->qvel[block->dof], m->opt.timestep, trocar_status_message(status),
                    slots->force_n);
        slots->reported = status;
    }
}

/* Puts an undeformed seal at rest where the joint is. */
static trocar_status begin(const mjData *d, int instance, trocar_slots *slots)
{
    const trocar_instance *block = shared(d, instance);
    trocar_state seal;
    const trocar_status status = trocar_state_init(block->model, &seal, d->qpos[block->position]);

    if (status != TROCAR_STATUS_OK) {
        return status;
    }
    slots->phase = PHASE_AT_REST;
    trocar_state_force(&seal, &slots->seal_force_n);
    return trocar_state_save(&seal, slots->seal, TROCAR_STATE_NUMBERS);
}

static trocar_status stored_seal(const mjData *d, int instance, const trocar_slots *slots, trocar_state *seal)
{
    return trocar_state_restore(shared(d, instance)->model, seal, slots->seal, TROCAR_STATE_NUMBERS, NULL, 0);
}

/* Where a step ends, by the force that acts in it. */
typedef struct {
    const trocar_model *model;
    const trocar_state *seal;
    double duration_s;
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
    const trocar_status status = trocar_step_to(end->model, &seal, position_m, end->duration_s, &tried.force_n);

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
    const double velocity_m_s = d->qvel[block->dof];
    const double mobility_per_kg = mobility(m, d, block->dof);
    trocar_state seal;
    trocar_status status = slots->phase == PHASE_RUNNING ? TROCAR_STATUS_OK : begin(d, instance, slots);
    step_end end = {block->model, &seal, step_s, 0.0, 0.0, status};
    double force_n;

    end.free_m = d->qpos[block->position] + step_s * velocity_m_s;
    end.free_m += step_s * step_s * slots->other_m_s2;
    end.compliance_m_n = step_s * step_s * mobility_per_kg;
    slots->open = 0.0;
    if (status == TROCAR_STATUS_OK) {
        status = stored_seal(d, instance, slots, &seal);
    }
    if (status != TROCAR_STATUS_OK) {
        return status;
    }
    force_n = force_of_step(&end);
    if (end.status != TROCAR_STATUS_OK) {
        return end.status;
    }
    slots->open = 1.0;
    slots->time_s = d->time;
    slots->velocity_m_s = velocity_m_s;
    slots->mobility_per_kg = mobility_per_kg;
    slots->force_n = force_n;
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

static int nsensordata(const mjModel *m, int instance, int sensor)
{
    (void)m, (void)instance, (void)sensor;
    return 1;
}

/* A sensor of the instance reads the force of the seal where the joint is. */
static void write_sensors(const mjModel *m, mjData *d, int instance)
{
    const double force_n = slots_of(m, d, instance)->seal_force_n;
    int sensor;

    for (sensor = 0; sensor < m->nsensor; sensor++) {
        if (m->sensor_type[sensor] == mjSENS_PLUGIN && m->sensor_plugin[sensor] == instance) {
            d->sensordata[m->sensor_adr[sensor]] = force_n;
        }
    }
}

static void compute(const mjModel *m, mjData *d, int instance, int capability)
{
    trocar_slots *slots = slots_of(m, d, instance);

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
    d->qfrc_passive[shared(d, instance)->dof] -= slots->force_n;
}

/* The step is taken: the seal follows to where the joint is. */
static void advance(const mjModel *m, mjData *d, int instance)
{
    const trocar_instance *block = shared(d, instance);
    const double step_s = m->opt.timestep;
    trocar_slots *slots = slots_of(m, d, instance);
    trocar_state seal;
    double force_n = 0.0;
    trocar_status status = slots->phase == PHASE_UNSET ? begin(d, instance, slots) : TROCAR_STATUS_OK;

    if (status == TROCAR_STATUS_OK) {
        status = stored_seal(d, instance, slots, &seal);
    }
    if (status == TROCAR_STATUS_OK) {
        status = trocar_step_to(block->model, &seal, d->qpos[block->position], step_s, &force_n);
    }
    if (status != TROCAR_STATUS_OK) {
        report(m, d, instance, slots, status);
    } else {
        trocar_state_save(&seal, slots->seal, TROCAR_STATE_NUMBERS);
        slots->seal_force_n = force_n;
        slots->phase = PHASE_RUNNING;
        slots->reported = TROCAR_STATUS_OK;
    }
    slots->other_m_s2 = 0.0;
    if (slots->open != 0.0 && status == TROCAR_STATUS_OK) {
        const double gained_m_s2 = (d->qvel[block->dof] - slots->velocity_m_s) / step_s;
        const double other_m_s2 = gained_m_s2 + slots->mobility_per_kg * slots->force_n;
        slots->other_m_s2 = isfinite(other_m_s2) ? other_m_s2 : 0.0;
    }
    slots->open = 0.0;
}

mjPLUGIN_LIB_INIT(trocar)
{
    static const char *const attributes[] = {"model", "joint"};
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
