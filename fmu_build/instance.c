/* One simulated motor: its values, its phase, its steps. Knows the model's table, nothing of an FMI version.
 *
 * fmi.c, fmi2.c and fmi3.c turn their functions into calls of these. No function here keeps anything outside its
 * instance. All that a saved state must hold is in State, which is plain data. Value references: the table's rows, the
 * time, the derivatives of the states, the margins of the modes.
 */
#include "modes.c"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define MODEL_EXPORT __declspec(dllexport)
#else
#define MODEL_EXPORT __attribute__((visibility("default")))
#endif

/* Kept out of the way of what is called for every step. */
#if defined(__GNUC__)
#define INSTANCE_RARE __attribute__((noinline))
#else
#define INSTANCE_RARE
#endif

#define TIME_LIMIT 1e9 /* s: beyond, microseconds drown in rounding */

typedef enum { INSTANCE_OK = 0, INSTANCE_DISCARD = 2, INSTANCE_ERROR = 3 } Status; /* FMI's numbers */

typedef enum {
    PHASE_INSTANTIATED,
    PHASE_INITIALIZATION,
    PHASE_STEPPING,   /* co-simulation */
    PHASE_EVENT,      /* model exchange */
    PHASE_CONTINUOUS, /* model exchange */
    PHASE_TERMINATED,
    PHASE_FAILED
} Phase;

#define FIRST_DERIVATIVE (unsigned int)(N_VARIABLES + 1) /* value reference; the time's is the one before */
#define FIRST_MARGIN (FIRST_DERIVATIVE + N_STATES)
#define INDICATOR_SHIFT 1e-12 /* an event indicator is not 0 where a mode begins at its end, as FMI wants it */

typedef struct {
    Values values;
    double step;      /* s: the last communication step; 0: none yet */
    double substep;   /* s: of the last step of a model that is not linear; 0: none yet */
    double stop_time; /* s; TIME_LIMIT if the importer defines none */
    int64_t phase;
} State;

typedef struct Instance {
    State state;
    Solution solution;       /* as far as it is computed for the parameters as they are */
    bool outputs_follow;     /* modes and calculated outputs follow from the other values */
    bool model_exchange;     /* the importer integrates */
    bool log_discard;
    bool log_error;
    void (*log)(const struct Instance *instance, Status status, const char *message);
} Instance;

/* What may be logged; the same names in every version of FMI. */
typedef struct {
    const char *name, *description;
} LogCategory;

enum { LOG_ALL, LOG_DISCARD, LOG_ERROR, N_LOG_CATEGORIES };
static const LogCategory log_categories[N_LOG_CATEGORIES] = {
    {"logAll", "All messages"},
    {"logStatusDiscard", "Values that were refused"},
    {"logStatusError", "Calls and steps that failed"},
};

/* What fmu_build reads back from the library, to describe it and to check it. */
typedef struct {
    int variables;
    int linear;
    int log_categories;
    const TableRow *table;
    const LogCategory *log_category;
    void (*derivatives)(const Values *values, Rates *rates);
    void (*switches)(const Values *values, Margins *margins);
} ModelInfo;

MODEL_EXPORT const ModelInfo *fmu_build_model(void);

static void model_derivatives(const Values *values, Rates *rates)
{
    derivatives(&values->named, &rates->named);
}

MODEL_EXPORT const ModelInfo *fmu_build_model(void)
{
    static const ModelInfo info = {N_VARIABLES,    MODEL_LINEAR,      N_LOG_CATEGORIES, model_table,
                                   log_categories, model_derivatives, model_switches};
    return &info;
}

/* Log where the importer asked for it; return the status. */
INSTANCE_RARE static Status instance_report(const Instance *instance, Status status, const char *format, ...)
{
    char message[256];
    va_list arguments;
    if (instance->log == NULL) return status;
    if (status == INSTANCE_DISCARD ? !instance->log_discard : !instance->log_error) return status;
    va_start(arguments, format);
    (void)vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    instance->log(instance, status, message);
    return status;
}

static inline double *instance_time(Instance *instance)
{
    return &instance->state.values.flat[N_VARIABLES];
}

/* Modes follow from the start values; so they begin anew when these are set. */
static void instance_reset_modes(Instance *instance)
{
    for (int k = 0; k < N_MODES; k++) {
        const int place = model_mode_places[k];
        instance->state.values.flat[place] = model_table[place].start;
    }
}

/* As freshly instantiated. */
static void instance_reset(Instance *instance)
{
    for (int k = 0; k < N_VARIABLES; k++)
        instance->state.values.flat[k] = model_table[k].kind == MODEL_output ? 0 : model_table[k].start;
    *instance_time(instance) = 0;
    instance->state.step = 0;
    instance->state.substep = 0;
    instance->state.stop_time = TIME_LIMIT;
    instance->state.phase = PHASE_INSTANTIATED;
    solution_forget(&instance->solution);
    instance->outputs_follow = false;
}

/* Whether a state that came from outside can be one of this instance. */
static bool instance_is_sane(const Instance *instance, const State *state)
{
    const bool exchanged = state->phase == PHASE_EVENT || state->phase == PHASE_CONTINUOUS;
    bool sane = state->phase >= PHASE_INSTANTIATED && state->phase <= PHASE_FAILED;
    sane = sane && !(instance->model_exchange ? state->phase == PHASE_STEPPING : exchanged);
    sane = sane && state->step >= 0 && state->substep >= 0 && !isnan(state->stop_time);
    for (int k = 0; k <= N_VARIABLES; k++) sane = sane && isfinite(state->values.flat[k]);
    for (int k = 0; k < N_MODES; k++) {
        const int place = model_mode_places[k];
        const double mode = state->values.flat[place];
        sane = sane && mode >= model_table[place].min && mode <= model_table[place].max;
    }
    return sane;
}

static void instance_restore(Instance *instance, const State *state)
{
    instance->state = *state;
    solution_forget(&instance->solution);
    instance->outputs_follow = false;
}

static Status instance_refuse(const Instance *instance, const char *call)
{
    static const char *const phases[] = {"before initialisation",   "in initialisation", "between steps", "in event mode",
                                         "in continuous-time mode", "after termination", "after a failed step"};
    const int64_t phase = instance->state.phase;
    return instance_report(instance, INSTANCE_ERROR, "%s is not allowed %s", call,
                           phase >= 0 && phase <= PHASE_FAILED ? phases[phase] : "now");
}

static Status instance_set_up(Instance *instance, double start_time, bool has_stop_time, double stop_time)
{
    if (instance->state.phase != PHASE_INSTANTIATED) return instance_refuse(instance, "setting up the experiment");
    if (!(fabs(start_time) <= TIME_LIMIT))
        return instance_report(instance, INSTANCE_ERROR, "start time %g s is not within +-%g s", start_time,
                               TIME_LIMIT);
    if (has_stop_time && !(stop_time >= start_time))
        return instance_report(instance, INSTANCE_ERROR, "stop time %g s is before start time %g s", stop_time,
                               start_time);
    *instance_time(instance) = start_time;
    instance->state.stop_time = has_stop_time && stop_time < TIME_LIMIT ? stop_time : TIME_LIMIT;
    return INSTANCE_OK;
}

/* From one phase to the next. */
static Status instance_enter(Instance *instance, Phase from, Phase to, const char *call)
{
    if (instance->state.phase != (int64_t)from) return instance_refuse(instance, call);
    instance->state.phase = to;
    solution_forget(&instance->solution);
    return INSTANCE_OK;
}

/* Change the modes that have ended. */
static Status instance_settle(Instance *instance, bool *changed)
{
    Margins margins;
    *changed = false;
    if (N_MODES == 0) return INSTANCE_OK;
    if (!modes_settle(&instance->state.values, &margins, changed))
        return instance_report(instance, INSTANCE_ERROR, "the modes of the model change without end");
    if (*changed) solution_forget(&instance->solution);
    if (*changed) instance->outputs_follow = false;
    return INSTANCE_OK;
}

static Status instance_exit_initialization(Instance *instance)
{
    bool changed;
    if (instance->state.phase == PHASE_INITIALIZATION && instance_settle(instance, &changed) != INSTANCE_OK)
        return INSTANCE_ERROR;
    return instance_enter(instance, PHASE_INITIALIZATION, instance->model_exchange ? PHASE_EVENT : PHASE_STEPPING,
                          "leaving initialisation");
}

static Status instance_terminate(Instance *instance)
{
    const int64_t phase = instance->state.phase;
    if (phase < PHASE_STEPPING || phase > PHASE_CONTINUOUS) return instance_refuse(instance, "termination");
    return instance_enter(instance, (Phase)phase, PHASE_TERMINATED, "termination");
}

/* Calculate the outputs that the model calculates; false if one is infinite or NaN. In model exchange, the importer
   says when modes change. */
static bool instance_calculate_outputs(Instance *instance)
{
    Rates rates;
    double sum = 0;
    bool changed;
    if (instance->state.phase <= PHASE_STEPPING && instance_settle(instance, &changed) != INSTANCE_OK) return false;
    derivatives(&instance->state.values.named, &rates.named);
    for (int k = 0; k < N_OUTPUTS; k++) {
        instance->state.values.flat[model_output_places[k]] = rates.flat[N_STATES + k];
        sum += fabs(rates.flat[N_STATES + k]);
    }
    instance->outputs_follow = isfinite(sum);
    return instance->outputs_follow;
}

/* What follows the first value reference that is past the table: derivatives and margins too. */
INSTANCE_RARE static Status instance_get_any(Instance *instance, unsigned int limit, const unsigned int *references,
                                             size_t count, double *values)
{
    Rates rates;
    Margins margins;
    derivatives(&instance->state.values.named, &rates.named);
    model_switches(&instance->state.values, &margins);
    for (size_t k = 0; k < count; k++) {
        const unsigned int reference = references[k];
        if (reference < limit) {
            values[k] = instance->state.values.flat[reference];
        } else if (reference >= FIRST_DERIVATIVE && reference < FIRST_DERIVATIVE + N_STATES) {
            values[k] = rates.flat[reference - FIRST_DERIVATIVE];
            if (!isfinite(values[k])) return instance_report(instance, INSTANCE_ERROR, "a derivative is not finite");
        } else if (reference >= FIRST_MARGIN && reference < FIRST_MARGIN + N_MODES) {
            values[k] = margins.flat[reference - FIRST_MARGIN].margin;
            if (!isfinite(values[k])) return instance_report(instance, INSTANCE_ERROR, "a margin is not finite");
        } else {
            return instance_report(instance, INSTANCE_ERROR, "there is no variable with value reference %u", reference);
        }
    }
    return INSTANCE_OK;
}

/* Whether an array of count elements is given; a call without it is an error, not a crash. */
static inline bool is_given(const void *array, size_t count)
{
    return array != NULL || count == 0;
}

INSTANCE_RARE static Status instance_miss(const Instance *instance)
{
    return instance_report(instance, INSTANCE_ERROR, "an array is missing: its pointer is NULL");
}

/* limit is the number of the table's value references: N_VARIABLES, or one more where the time is a variable. */
static inline Status instance_get(Instance *instance, unsigned int limit, const unsigned int *references, size_t count,
                                  double *values)
{
    if (!is_given(references, count) || !is_given(values, count)) return instance_miss(instance);
    if (N_OUTPUTS + N_MODES > 0 && !instance->outputs_follow && !instance_calculate_outputs(instance))
        return instance_report(instance, INSTANCE_ERROR, "a calculated output is not finite");
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= limit)
            return instance_get_any(instance, limit, references + k, count - k, values + k);
        values[k] = instance->state.values.flat[references[k]];
    }
    return INSTANCE_OK;
}

/* Set all or none. */
static Status instance_set(Instance *instance, const unsigned int *references, size_t count, const double *values)
{
    const int64_t phase = instance->state.phase;
    bool only_inputs = true;
    if (phase > PHASE_CONTINUOUS) return instance_refuse(instance, "setting a variable");
    if (!is_given(references, count) || !is_given(values, count)) return instance_miss(instance);
    for (size_t k = 0; k < count; k++) {
        const TableRow *row;
        if (references[k] >= N_VARIABLES)
            return instance_report(instance, INSTANCE_ERROR, "no variable with value reference %u can be set",
                                   references[k]);
        row = &model_table[references[k]];
        if (row->kind >= MODEL_output || (row->kind == MODEL_state && phase >= PHASE_STEPPING))
            return instance_report(instance, INSTANCE_ERROR, "%s %s cannot be set%s",
                                   row->kind == MODEL_mode ? "mode" : "output", row->name,
                                   row->kind >= MODEL_output ? "" : " after initialisation");
        if (row->kind == MODEL_parameter && phase == PHASE_CONTINUOUS)
            return instance_report(instance, INSTANCE_ERROR, "parameter %s cannot be set in continuous-time mode",
                                   row->name);
        if (!(values[k] >= row->min && values[k] <= row->max))
            return instance_report(instance, INSTANCE_DISCARD, "%s = %g %s is not within %g and %g", row->name,
                                   values[k], row->unit, row->min, row->max);
        only_inputs = only_inputs && row->kind == MODEL_input;
    }
    for (size_t k = 0; k < count; k++) instance->state.values.flat[references[k]] = values[k];
    instance->outputs_follow = false;
    if (N_MODES > 0 && phase <= PHASE_INITIALIZATION) instance_reset_modes(instance);
    instance->solution.inputs++;
    if (!only_inputs) solution_forget(&instance->solution);
    return INSTANCE_OK;
}

INSTANCE_RARE static Status instance_fail(Instance *instance, double time)
{
    instance->state.phase = PHASE_FAILED;
    solution_forget(&instance->solution);
    return instance_report(instance, INSTANCE_ERROR, "the step from %g s did not end in a finite state", time);
}

/* A step that is not one of many alike: the arguments are checked, what follows from parameters and step computed. */
INSTANCE_RARE static Status instance_step_with_care(Instance *instance, double time, double step)
{
    State *state = &instance->state;
    const double end = time + step;
    if (state->phase != PHASE_STEPPING) return instance_refuse(instance, "a step");
    if (!(step > 0 && isfinite(step)))
        return instance_report(instance, INSTANCE_ERROR, "communication step %g s is not positive", step);
    if (!(fabs(time) <= TIME_LIMIT) || end > state->stop_time + 1e-9 * fabs(state->stop_time)) /* importers round */
        return instance_report(instance, INSTANCE_ERROR, "a step from %g s to %g s passes the stop time %g s", time,
                               end, state->stop_time);
    /* Importers that subtract times (libcosim) pass steps that differ by the rounding of the times: the same step. */
    if (fabs(step - state->step) <= 2 * DBL_EPSILON * larger_of(fabs(time), fabs(end))) step = state->step;
    state->step = step;
    if (N_MODES > 0) {
        if (!modes_integrate(&instance->solution, &state->values, step)) return instance_fail(instance, time);
    } else if (MODEL_LINEAR) {
        if (!solution_prepare(&instance->solution, &state->values, step, true)) return instance_fail(instance, time);
        if (!propagator_step(instance->solution.propagator, &state->values)) return instance_fail(instance, time);
    } else {
        if (!rosenbrock_integrate(&state->values, step, &state->substep)) return instance_fail(instance, time);
    }
    *instance_time(instance) = end;
    instance->outputs_follow = N_OUTPUTS == 0; /* the modes do */
    return INSTANCE_OK;
}

/* From the communication point time to time + step. */
static inline Status instance_step(Instance *instance, double time, double step)
{
    const double end = time + step;
    /* A step as long as one of late, nothing else changed but inputs: what could be wrong was looked at then. */
    if (MODEL_LINEAR && end <= instance->state.stop_time &&
        solution_step(&instance->solution, &instance->state.values, step)) {
        instance->state.step = step;
        *instance_time(instance) = end;
        instance->outputs_follow = N_OUTPUTS == 0; /* the modes do */
        return INSTANCE_OK;
    }
    return instance_step_with_care(instance, time, step);
}

/* ---- Model exchange ---- */

/* Whether a call that only model exchange has may be made from one phase to another. */
static bool instance_exchanges(const Instance *instance, Phase from, Phase to)
{
    return instance->model_exchange && instance->state.phase >= (int64_t)from && instance->state.phase <= (int64_t)to;
}

static Status instance_set_time(Instance *instance, double time)
{
    if (!instance_exchanges(instance, PHASE_EVENT, PHASE_CONTINUOUS))
        return instance_refuse(instance, "setting the time");
    if (!(fabs(time) <= TIME_LIMIT))
        return instance_report(instance, INSTANCE_ERROR, "time %g s is not within +-%g s", time, TIME_LIMIT);
    *instance_time(instance) = time;
    return INSTANCE_OK;
}

static Status instance_set_states(Instance *instance, const double *states, size_t count)
{
    if (!instance_exchanges(instance, PHASE_CONTINUOUS, PHASE_CONTINUOUS))
        return instance_refuse(instance, "setting the states");
    if (count != N_STATES)
        return instance_report(instance, INSTANCE_ERROR, "there are %d states, not %lu", N_STATES,
                               (unsigned long)count);
    if (!is_given(states, count)) return instance_miss(instance);
    for (int k = 0; k < N_STATES; k++)
        if (!isfinite(states[k]))
            return instance_report(instance, INSTANCE_DISCARD, "state %s = %g is not finite",
                                   model_table[model_state_places[k]].name, states[k]);
    for (int k = 0; k < N_STATES; k++) instance->state.values.flat[model_state_places[k]] = states[k];
    instance->outputs_follow = false;
    return INSTANCE_OK;
}

/* Event indicators: above 0 while a mode lasts. */
static Status instance_get_indicators(Instance *instance, double *values, size_t count)
{
    Margins margins;
    bool changed;
    if (!instance_exchanges(instance, PHASE_INITIALIZATION, PHASE_TERMINATED))
        return instance_refuse(instance, "reading event indicators");
    if (instance->state.phase == PHASE_INITIALIZATION && instance_settle(instance, &changed) != INSTANCE_OK)
        return INSTANCE_ERROR;
    if (count != N_MODES)
        return instance_report(instance, INSTANCE_ERROR, "there are %d event indicators, not %lu", N_MODES,
                               (unsigned long)count);
    if (!is_given(values, count)) return instance_miss(instance);
    model_switches(&instance->state.values, &margins);
    for (int k = 0; k < N_MODES; k++) {
        values[k] = margins.flat[k].margin + INDICATOR_SHIFT;
        if (!isfinite(values[k])) return instance_report(instance, INSTANCE_DISCARD, "a margin is not finite");
    }
    return INSTANCE_OK;
}

typedef enum { OF_STATES, OF_DERIVATIVES, OF_NOMINALS } StateVector;

static Status instance_get_states(Instance *instance, StateVector what, double *values, size_t count)
{
    Rates rates;
    if (!instance_exchanges(instance, what == OF_NOMINALS ? PHASE_INSTANTIATED : PHASE_INITIALIZATION,
                            PHASE_TERMINATED))
        return instance_refuse(instance, "reading the states, their derivatives or nominals");
    if (count != N_STATES)
        return instance_report(instance, INSTANCE_ERROR, "there are %d states, not %lu", N_STATES,
                               (unsigned long)count);
    if (!is_given(values, count)) return instance_miss(instance);
    if (what == OF_DERIVATIVES) {
        double sum = 0;
        bool changed;
        if (instance->state.phase == PHASE_INITIALIZATION && instance_settle(instance, &changed) != INSTANCE_OK)
            return INSTANCE_ERROR;
        derivatives(&instance->state.values.named, &rates.named);
        for (int k = 0; k < N_STATES; k++) sum += fabs(rates.flat[k]);
        if (!isfinite(sum)) return instance_report(instance, INSTANCE_DISCARD, "a derivative is not finite");
    }
    for (int k = 0; k < N_STATES; k++) {
        const int place = model_state_places[k];
        values[k] = what == OF_STATES        ? instance->state.values.flat[place]
                    : what == OF_DERIVATIVES ? rates.flat[k]
                                             : model_table[place].nominal;
    }
    return INSTANCE_OK;
}

#include "sensitivity.c"
