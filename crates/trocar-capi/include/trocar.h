/*
 * trocar: friction between a surgical instrument and the trocar seal it passes through.
 *
 * SI units. Positive is insertion. Forces are those of the instrument on the seal; the instrument feels their negative.
 *
 * Every call that can be refused gives a status, and leaves model, state and compensator as they were unless that is
 * TROCAR_STATUS_OK. NULL and misaligned pointers are refused (TROCAR_STATUS_NULL_POINTER, TROCAR_STATUS_MISALIGNED), and
 * so is what is no model or no compensator (TROCAR_STATUS_NOT_A_MODEL, TROCAR_STATUS_NOT_A_COMPENSATOR). Any other
 * pointer must be valid.
 *
 * Threads: a model never changes, any number of threads may use it at once, except for trocar_model_free(). A state
 * and a compensator belong to one thread at a time. Different ones never share anything.
 *
 * Memory: loading, parsing, tuning and freeing a model allocate or free, and so do making and freeing a compensator.
 * Nothing else does.
 *
 * Made from the Rust source by cbindgen; do not edit. Licence: MIT OR Apache-2.0.
 */
#ifndef TROCAR_H
#define TROCAR_H

#include <stddef.h>
#include <stdint.h>

#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L && !defined(__cplusplus)
#define TROCAR_STATIC_ASSERT(condition, message) _Static_assert(condition, message)
#elif defined(__cplusplus) && __cplusplus >= 201103L
#define TROCAR_STATIC_ASSERT(condition, message) static_assert(condition, message)
#else
#define TROCAR_STATIC_ASSERT(condition, message) struct trocar_nothing_to_assert
#endif

/**
 * Version of this interface: of its functions, their meaning, and the layout of a state and of all structs. Programs
 * compiled for one version must not run with a library of another; compare with trocar_abi_version().
 */
#define TROCAR_ABI_VERSION 5

/**
 * Bytes of a state.
 */
#define TROCAR_STATE_SIZE 480

/**
 * Numbers of a saved state, trocar_state_save().
 */
#define TROCAR_STATE_NUMBERS 55

/**
 * Bytes that do for nearly all messages.
 */
#define TROCAR_MESSAGE_SIZE 512

/**
 * Mode of a seal that sticks to the instrument and deforms, trocar_state_mode().
 */
#define TROCAR_MODE_DEFORMING 0

/**
 * Mode of a seal that the instrument slides through.
 */
#define TROCAR_MODE_SLIDING 1

/**
 * What became of a call. Whatever is not TROCAR_STATUS_OK left model, state and compensator as they were.
 */
enum trocar_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Done.
     */
    TROCAR_STATUS_OK = 0,
    /**
     * A pointer is NULL.
     */
    TROCAR_STATUS_NULL_POINTER = 1,
    /**
     * A pointer is not aligned for what it points to.
     */
    TROCAR_STATUS_MISALIGNED = 2,
    /**
     * The pointer to a model does not point to one; it may have been freed.
     */
    TROCAR_STATUS_NOT_A_MODEL = 3,
    /**
     * The memory of a state holds none: not initialised, its mark overwritten or a number no longer finite, or of another
     * version of the library.
     */
    TROCAR_STATUS_NOT_A_STATE = 4,
    /**
     * The state was initialised for another model.
     */
    TROCAR_STATUS_OTHER_MODEL = 5,
    /**
     * Another thread is using the state or the compensator.
     */
    TROCAR_STATUS_STATE_BUSY = 6,
    /**
     * A number is NaN or infinite, or the position, velocity or state it leads to is.
     */
    TROCAR_STATUS_NOT_FINITE = 7,
    /**
     * The duration of a step is zero or negative.
     */
    TROCAR_STATUS_DURATION_NOT_POSITIVE = 8,
    /**
     * An index or a number of elements is out of range.
     */
    TROCAR_STATUS_OUT_OF_RANGE = 9,
    /**
     * The model has no such quantity: classical models have no deflection and no mode, and not every model states how
     * far off its force is.
     */
    TROCAR_STATUS_UNSUPPORTED = 10,
    /**
     * The model file cannot be read.
     */
    TROCAR_STATUS_MODEL_UNREADABLE = 11,
    /**
     * The text is no model, or its values make none.
     */
    TROCAR_STATUS_MODEL_INVALID = 12,
    /**
     * The model was written by another version of trocar.
     */
    TROCAR_STATUS_MODEL_NEWER = 13,
    /**
     * A defect of the library; please report it. The compensator of such a call is lost.
     */
    TROCAR_STATUS_INTERNAL = 14,
    /**
     * The pointer to a compensator does not point to one; it may have been freed.
     */
    TROCAR_STATUS_NOT_A_COMPENSATOR = 15,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum trocar_status trocar_status;
#else
typedef int32_t trocar_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What cannot be right about a sample. No error of the call: what the compensator makes of it is defined.
 */
enum trocar_fault
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Nothing.
     */
    TROCAR_FAULT_NONE = 0,
    /**
     * The reading is NaN or infinite: no tissue force, the model goes on.
     */
    TROCAR_FAULT_NO_READING = 1,
    /**
     * The position, or the angle, is NaN or infinite: no tissue force, the model waits.
     */
    TROCAR_FAULT_NO_POSITION = 2,
    /**
     * The duration is not above 0 and finite: the model waits.
     */
    TROCAR_FAULT_NO_DURATION = 3,
    /**
     * The reading is at the sensor's limit: no tissue force, it is larger.
     */
    TROCAR_FAULT_SATURATED = 4,
    /**
     * The reading has not changed although the force must have: no tissue force.
     */
    TROCAR_FAULT_FROZEN = 5,
    /**
     * The position, or the surface of a turning shaft, moved faster than 1 m/s, and by more than 1 mm: a new zero of the encoder, not a motion.
     */
    TROCAR_FAULT_JUMP = 6,
    /**
     * More than 0.2 s since the last sample: the state of the seal is unknown until it has slid.
     */
    TROCAR_FAULT_GAP = 7,
    /**
     * The reading, or the position, has the opposite sign of the model's over several strokes: no tissue force.
     */
    TROCAR_FAULT_OPPOSITE_SIGN = 8,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum trocar_fault trocar_fault;
#else
typedef int32_t trocar_fault;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * An observer of the force on the tissue: what a sensor outside the body reads less what the trocar takes. Made by
 * trocar_compensator_new(), ended by trocar_compensator_free(). It keeps a copy of what it needs of its model.
 *
 * One thread at a time may use a compensator. A second one gets TROCAR_STATUS_STATE_BUSY. After a call that ended with
 * TROCAR_STATUS_INTERNAL it is lost: all calls but trocar_compensator_free() give that status from then on.
 */
typedef struct trocar_compensator trocar_compensator;

/**
 * A model: a seal, and how its force depends on the way. Made by trocar_model_load() and its like, ended by
 * trocar_model_free(), immutable in between: any number of threads may use one at the same time.
 */
typedef struct trocar_model trocar_model;

/**
 * How a compensator is set up. trocar_compensator_options_init() fills it; NaN stands for the value in the model file.
 */
typedef struct {
    /**
     * Size of this struct in bytes; a library that knows another one refuses it.
     */
    size_t struct_size;
    /**
     * Reading without any force, N, with the sign of the readings; NaN: as in the model file, else 0.
     */
    double offset_n;
    /**
     * Mass between sensor and seal, kg, 0 or more; NaN: as in the model file, else 0.
     */
    double moving_mass_kg;
    /**
     * Gravity as it acts on the reading of the moving mass, m/s²; 0 where the weight is part of the offset,
     * as it is of the offset of a model file: with gravity, state offset_n without the weight.
     */
    double gravity_m_s2;
    /**
     * Largest force that the sensor can read, N, above 0; NaN: none is known.
     */
    double sensor_limit_n;
    /**
     * Standard deviation of the model's force, N, 0 or more; NaN: as in the model file, by phase.
     */
    double force_error_n;
    /**
     * 1: friction and viscosity are adapted in use; 0: they stay those of the model.
     */
    int32_t adaptation;
    /**
     * Whether the sign of each reading is reversed, 1 or 0; -1: as the recordings of the model file were, else 0.
     */
    int32_t flip_force;
} trocar_compensator_options;

/**
 * Estimate of a compensator after each sample. Forces are those of the instrument on what it touches.
 */
typedef struct {
    /**
     * Force on seal and trocar, N.
     */
    double trocar_force_n;
    /**
     * Force on the tissue, N; NaN where the reading does not determine it.
     */
    double tissue_force_n;
    /**
     * Standard deviation of both, N; NaN before the first position.
     */
    double tissue_force_std_n;
    /**
     * 1 while friction and viscosity are being adapted, 0 during contact with tissue or without informative motion.
     */
    int32_t adapting;
    /**
     * What cannot be right about this sample.
     */
    trocar_fault fault;
} trocar_estimate;

/**
 * Where friction and viscosity stand, over those of the model.
 */
typedef struct {
    /**
     * Friction without its viscous part; wetting lowers it.
     */
    double level;
    /**
     * Viscous part.
     */
    double viscosity;
    /**
     * Standard deviation of level.
     */
    double level_std;
    /**
     * Standard deviation of viscosity.
     */
    double viscosity_std;
} trocar_drift;

/**
 * A number of a model that can be adjusted by itself, trocar_model_tunable(). The texts live as long as the model.
 */
typedef struct {
    /**
     * Name with its unit at the end, such as "half_width_m", or "element_2_half_width_m" of one of several elements.
     */
    const char *name;
    /**
     * Unit in SI such as "N s/m", "1" for a pure number.
     */
    const char *unit;
    /**
     * What it is.
     */
    const char *description;
    /**
     * Present value.
     */
    double value;
    /**
     * Least value allowed.
     */
    double least;
    /**
     * 1 where the least value itself is not allowed, else 0.
     */
    int32_t above_least;
    /**
     * Which of several elements it belongs to, from 1; 0 for what the model has once.
     */
    int32_t element;
} trocar_tunable;

/**
 * What changes while a model runs. The caller owns it: on the stack, in a struct, in an array, TROCAR_STATE_SIZE bytes
 * aligned to 8. It holds no pointer and need not be freed; a copy made while nobody steps it is a valid state. Before the
 * first use trocar_state_init() or its like must fill it: memory without its mark, or with a number that is not finite, is
 * refused, TROCAR_STATUS_NOT_A_STATE. Finite numbers written over its own are not noticed.
 *
 * One thread at a time may use a state. A second one gets TROCAR_STATUS_STATE_BUSY.
 */
typedef struct {
    /**
     * Not for the caller.
     */
    uint64_t words[60];
} trocar_state;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Version of the interface that the library was built with: TROCAR_ABI_VERSION of its header. Never fails.
 */
uint32_t trocar_abi_version(void);

/**
 * Version of the library, such as "0.1.0". Lives as long as the program. Never fails.
 */
const char *trocar_version(void);

/**
 * Fills options with what trocar_compensator_new() takes for NULL: all as in the model file, with adaptation.
 * struct_size is sizeof *options.
 *
 * Refuses: TROCAR_STATUS_OUT_OF_RANGE where the library knows a struct of another size; it then writes nothing.
 */
trocar_status trocar_compensator_options_init(trocar_compensator_options *options,
                                              size_t struct_size);

/**
 * Makes a compensator for model and gives it to *compensator; NULL where it is refused. options may be NULL. The model
 * may be freed afterwards. It starts with the first sample. Give it back with trocar_compensator_free(). Allocates;
 * message as for trocar_model_load().
 *
 * Refuses: TROCAR_STATUS_OUT_OF_RANGE for an option, TROCAR_STATUS_UNSUPPORTED where neither the model file nor
 * force_error_n states how far off the model's force is, and where neither the model file nor flip_force states the sign.
 */
trocar_status trocar_compensator_new(const trocar_model *model,
                                     const trocar_compensator_options *options,
                                     trocar_compensator **compensator,
                                     char *message,
                                     size_t message_size);

/**
 * Frees a compensator; NULL is allowed. No thread may use it later.
 *
 * Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
 */
trocar_status trocar_compensator_free(trocar_compensator *compensator);

/**
 * Takes the next sample: instrument at position_m (m, positive is insertion), reading force_n (N) with the sign that the
 * sensor gives it (see flip_force of the options), duration_s (s) after the last one; the first sample starts, whatever its
 * duration. No allocation, bounded work.
 *
 * Any number is accepted, also NaN: see the fault in *estimate. If the call is refused, *estimate has no tissue force
 * (NaN) and a trocar force of 0.
 *
 * Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
 */
trocar_status trocar_compensator_step(trocar_compensator *compensator,
                                      double position_m,
                                      double force_n,
                                      double duration_s,
                                      trocar_estimate *estimate);

/**
 * The same where the instrument is at angle_rad (rad), with the torque of the instrument on the seal (N·m) in *torque_n_m, 0
 * if the call is refused. trocar_compensator_step() leaves the angle as it is.
 *
 * Refuses: as trocar_compensator_step(), and TROCAR_STATUS_UNSUPPORTED for a model without rotation.
 */
trocar_status trocar_compensator_turn(trocar_compensator *compensator,
                                      double position_m,
                                      double angle_rad,
                                      double force_n,
                                      double duration_s,
                                      trocar_estimate *estimate,
                                      double *torque_n_m);

/**
 * Where friction and viscosity stand.
 *
 * Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
 */
trocar_status trocar_compensator_drift(const trocar_compensator *compensator, trocar_drift *drift);

/**
 * Forgets all samples: the compensator is as new and starts with the next one. No allocation.
 *
 * Refuses: TROCAR_STATUS_NOT_A_COMPENSATOR, TROCAR_STATUS_STATE_BUSY.
 */
trocar_status trocar_compensator_reset(trocar_compensator *compensator);

/**
 * What a fault means, in English. Lives as long as the program. Never fails: a number that is no fault is called
 * "unknown fault".
 */
const char *trocar_fault_message(int32_t fault);

/**
 * Reads and checks the model file at path and gives it to *model, which the caller ends with trocar_model_free().
 * Allocates, and takes its time: not for a control loop. Where it fails, *model is NULL and message holds what is
 * wrong, with the place in the file.
 *
 * path is NUL-terminated (UTF-8 on Windows). message may be NULL; else it points to message_size bytes, and what does
 * not fit is cut; "" on success. TROCAR_MESSAGE_SIZE bytes do for nearly all messages.
 *
 * Refuses: TROCAR_STATUS_MODEL_UNREADABLE, TROCAR_STATUS_MODEL_INVALID, TROCAR_STATUS_MODEL_NEWER.
 */
trocar_status trocar_model_load(const char *path,
                                trocar_model **model,
                                char *message,
                                size_t message_size);

/**
 * The same from the text of a model file: json_length bytes of UTF-8 at json, which need no NUL at their end and may be
 * freed afterwards.
 */
trocar_status trocar_model_parse(const char *json,
                                 size_t json_length,
                                 trocar_model **model,
                                 char *message,
                                 size_t message_size);

/**
 * A made-up one-stage 10.5 mm trocar, to try things with: no trocar was measured. Give it back with
 * trocar_model_free(). Allocates.
 */
trocar_status trocar_model_plausible(trocar_model **model);

/**
 * A copy of model with new values, SI, in the order of trocar_model_tunable(); those past count stay. The same values
 * give the same model, to the last bit. States of model go on under the copy. Give it back with trocar_model_free().
 * Allocates; message as for trocar_model_load().
 *
 * Refuses: TROCAR_STATUS_OUT_OF_RANGE where count exceeds trocar_model_tunable_count(), TROCAR_STATUS_MODEL_INVALID.
 */
trocar_status trocar_model_tuned(const trocar_model *model,
                                 const double *values,
                                 size_t count,
                                 trocar_model **tuned,
                                 char *message,
                                 size_t message_size);

/**
 * Frees a model; NULL is allowed. No thread may use the model during the call or later. States are not touched.
 */
trocar_status trocar_model_free(trocar_model *model);

/**
 * Kind of the model: "ems", or the kind of a classical model as in its file. Lives as long as the program. NULL for a pointer
 * that is no model.
 */
const char *trocar_model_kind(const trocar_model *model);

/**
 * How many numbers of the model can be adjusted.
 */
trocar_status trocar_model_tunable_count(const trocar_model *model, size_t *count);

/**
 * The number at index, from 0, with its name, unit and range.
 *
 * Refuses: TROCAR_STATUS_OUT_OF_RANGE.
 */
trocar_status trocar_model_tunable(const trocar_model *model,
                                   size_t index,
                                   trocar_tunable *tunable);

/**
 * Fills state: an undeformed seal at rest, with the instrument at position_m (m, positive is insertion). To be called
 * before anything else is done with a state, and again at any time; no other thread may use the state meanwhile.
 *
 * Refuses: TROCAR_STATUS_NOT_FINITE.
 */
trocar_status trocar_state_init(const trocar_model *model,
                                trocar_state *state,
                                double position_m);

/**
 * The same with a seal that holds force_n (N, of the instrument on the seal, positive on insertion), clamped to what
 * the model can hold at rest.
 */
trocar_status trocar_state_init_at_force(const trocar_model *model,
                                         trocar_state *state,
                                         double position_m,
                                         double force_n);

/**
 * The same with A seal deformed by deflection_m (m, positive with insertion).
 *
 * Refuses: TROCAR_STATUS_UNSUPPORTED for a classical model, which knows no deflection.
 */
trocar_status trocar_state_init_at_deflection(const trocar_model *model,
                                              trocar_state *state,
                                              double position_m,
                                              double deflection_m);

/**
 * Where the instrument is after the last step, m.
 */
trocar_status trocar_state_position(const trocar_state *state, double *position_m);

/**
 * Force after the last step, N: that of the instrument on the seal, positive on insertion. The instrument feels its
 * negative.
 */
trocar_status trocar_state_force(const trocar_state *state,
                                 double *force_n);

/**
 * Deflection of the seal after the last step, m, positive with insertion; the mean of several elements.
 *
 * Refuses: TROCAR_STATUS_UNSUPPORTED for a classical model.
 */
trocar_status trocar_state_deflection(const trocar_model *model,
                                      const trocar_state *state,
                                      double *deflection_m);

/**
 * TROCAR_MODE_SLIDING once every element slides, else TROCAR_MODE_DEFORMING.
 *
 * Refuses: TROCAR_STATUS_UNSUPPORTED for a classical model.
 */
trocar_status trocar_state_mode(const trocar_model *model,
                                const trocar_state *state,
                                int32_t *mode);

/**
 * Torque after the last step, N·m: that of the instrument on the seal, positive with the angle; 0 for a model without
 * rotation.
 */
trocar_status trocar_state_torque(const trocar_model *model,
                                  const trocar_state *state,
                                  double *torque_n_m);

/**
 * Writes the state as TROCAR_STATE_NUMBERS finite numbers, for a file or another program; count is the number that there is
 * place for. The numbers do not name their model.
 *
 * Refuses: TROCAR_STATUS_OUT_OF_RANGE where count is smaller.
 */
trocar_status trocar_state_save(const trocar_state *state,
                                double *numbers,
                                size_t count);

/**
 * Fills state with what trocar_state_save() wrote; from there on it gives the same forces, to the last bit. The numbers
 * must be those of a model of this kind with as many elements; so a state also moves from one such model to another.
 * message as for trocar_model_load().
 *
 * Refuses: TROCAR_STATUS_OUT_OF_RANGE where count is smaller than TROCAR_STATE_NUMBERS, TROCAR_STATUS_NOT_A_STATE.
 */
trocar_status trocar_state_restore(const trocar_model *model,
                                   trocar_state *state,
                                   const double *numbers,
                                   size_t count,
                                   char *message,
                                   size_t message_size);

/**
 * What a status means, in English. Lives as long as the program. Never fails: a number that is no status is
 * called "unknown status".
 */
const char *trocar_status_message(int32_t status);

/**
 * Advances by displacement_m (m, positive is insertion) within duration_s (s, above 0) at constant velocity, and gives
 * the force at the end to *force_n: N, that of the instrument on the seal, positive on insertion; the instrument feels
 * its negative. No allocation, bounded work. Where the call is refused the state stays as it was and *force_n is the
 * last force, or 0 where there is no state.
 *
 * Refuses: TROCAR_STATUS_NOT_FINITE, TROCAR_STATUS_DURATION_NOT_POSITIVE, TROCAR_STATUS_NOT_A_STATE, TROCAR_STATUS_OTHER_MODEL, TROCAR_STATUS_STATE_BUSY.
 */
trocar_status trocar_step(const trocar_model *model,
                          trocar_state *state,
                          double displacement_m,
                          double duration_s,
                          double *force_n);

/**
 * The same to position_m (m) instead of by a displacement: the one to use with an encoder, for its errors do not add up.
 */
trocar_status trocar_step_to(const trocar_model *model,
                             trocar_state *state,
                             double position_m,
                             double duration_s,
                             double *force_n);

/**
 * The same to position_m (m), while the instrument turns to angle_rad (rad, 0 where the state was initialised) at constant
 * velocity; the torque is then in trocar_state_torque(). The other steps leave the angle as it is.
 *
 * Refuses: TROCAR_STATUS_UNSUPPORTED for a model without rotation.
 */
trocar_status trocar_turn_to(const trocar_model *model,
                             trocar_state *state,
                             double position_m,
                             double angle_rad,
                             double duration_s,
                             double *force_n);

/**
 * The same at velocity_m_s (m/s, positive is insertion) for duration_s.
 */
trocar_status trocar_step_velocity(const trocar_model *model,
                                   trocar_state *state,
                                   double velocity_m_s,
                                   double duration_s,
                                   double *force_n);

/**
 * Many steps: from start_time_s (s), where state stands, to each of count positions position_m (m) at its time time_s
 * (s) in turn; force_n gets the force (N) there. The same forces as from trocar_step_to(), to the last bit. A row with
 * the time and position of the one before repeats the force. force_n may be the array position_m; no array may overlap
 * the state.
 *
 * Stops at the first row that cannot be followed, with the status of that step; *done (may be NULL) is the number of
 * valid forces, and state is that after the last of them.
 */
trocar_status trocar_simulate(const trocar_model *model,
                              trocar_state *state,
                              double start_time_s,
                              size_t count,
                              const double *time_s,
                              const double *position_m,
                              double *force_n,
                              size_t *done);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

TROCAR_STATIC_ASSERT(sizeof(trocar_state) == TROCAR_STATE_SIZE, "size of a state");

#endif /* TROCAR_H */
