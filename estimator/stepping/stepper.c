/* stepper: one candidate from reset to cost, over an FMU's own functions.
 *
 * Knows FMI 2.0 co-simulation, nothing of motors, searches or processes. Other versions and kinds come in the same
 * shape: FMI 3.0 through fmi3_adapter.h, model exchange and FMI 1.0 through model_exchange.h, variables that are no reals
 * through functions that Python gives. Python (fmu_instance.py) fills the
 * structures below; their ctypes mirrors stand there, in the same order.
 *
 * A candidate is simulated over all experiments (recordings) in turn:
 *
 *     reset, set parameters, initialise
 *     sample 0 is read, before the first step
 *     for every following sample: set the inputs of the sample before it where they changed, step, read
 *     cost += weight (shown - measured)^2, sample by sample, in the order of the outputs
 *
 * Guarantees: the sum is formed in one order, so equal candidates cost equal bits. A candidate stops as soon as its
 * running cost exceeds its bound; as no term is negative, it could not have come back below. Time is start + n h,
 * never accumulated. The floating-point environment and the numeric locale are the caller's again after every
 * candidate; an FMU that leaves them changed is found out, its candidate is simulated again with both restored
 * after every step, and so are all later ones.
 */
#include <fenv.h>
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gauss_newton.h"
#include "model_exchange.h"
#include "fmi2Functions.h"
#include "fmi3_adapter.h"
#include "sensors.h"
#include "trust_region.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#if defined(__SSE2__)
#include <xmmintrin.h>
/* Rounding, flush-to-zero, denormals-are-zero, exception masks; not the sticky flags. */
#define SSE_CONTROL_BITS 0xFFC0u
#endif

/* What became of a candidate. */
enum { FINISHED = 0, CUT_SHORT = 1, FAILED = 2, NOT_FINITE = 3 };

/* What the FMU was doing when it failed. */
enum { IN_INSTANTIATE = 1, IN_RESET, IN_SET, IN_SETUP, IN_INITIALISATION, IN_STEP, IN_READ };

enum { MAX_OUTPUTS = 64, MAX_INPUTS = 64, MESSAGE_SIZE = 512 };

/* The FMU's words: the last message of status discard or worse, and how many messages there were. */
typedef struct {
    int64_t messages;
    char last[MESSAGE_SIZE];
} Log;

typedef struct {
    int64_t reinstantiate; /* 0: fmi2Reset before each run; 1: free and instantiate */
    fmi2Component component;
    fmi2InstantiateTYPE *instantiate;
    fmi2FreeInstanceTYPE *free_instance;
    fmi2ResetTYPE *reset;
    fmi2SetupExperimentTYPE *setup_experiment;
    fmi2EnterInitializationModeTYPE *enter_initialization;
    fmi2ExitInitializationModeTYPE *exit_initialization;
    fmi2SetRealTYPE *set_real;
    fmi2GetRealTYPE *get_real;
    fmi2DoStepTYPE *do_step;
    const char *instance_name;
    const char *guid;
    const char *resources;
    const fmi2CallbackFunctions *callbacks;
    int64_t restore_every_step; /* set when the FMU was seen to change the floating-point environment or locale */
    fmi2SetIntegerTYPE *set_integer;
    fmi2SetBooleanTYPE *set_boolean;
    fmi2SetStringTYPE *set_string;
    fmi2Status (*set_other)(fmi2Component component, const Setting *setting); /* instead of the three; or NULL */
    fmi2SetRealInputDerivativesTYPE *set_derivatives; /* of an FMU that interpolates its inputs; or NULL */
    double *horizon; /* s: told until when the inputs stay as they are; or NULL */
} Fmu;

typedef struct {
    int64_t samples;           /* n */
    int64_t substeps;          /* communication steps a sampling interval */
    double start;              /* s */
    double interval;           /* s, sampling interval */
    const double *inputs;      /* [n][inputs] */
    const double *measured;    /* [n][outputs]; NaN: sample left out */
    const double *weights;     /* [outputs]: 1 / sigma^2 */
    int64_t complete;          /* no sample is left out */
    const Chain *chains;       /* [outputs], or NULL: sensors show the outputs as they are */
    const double *times;       /* [n] s, increasing from `start`; NULL: equidistant */
    const double *ends;        /* [n][inputs]: where one that goes linearly ends before the next row; NULL: there */
} Experiment;

typedef struct {
    int64_t parameters;
    int64_t inputs;
    int64_t outputs;
    int64_t experiments;
    const fmi2ValueReference *parameter_references;
    const fmi2ValueReference *input_references;
    const fmi2ValueReference *output_references;
    const int64_t *sensors;    /* [outputs]: IDENTITY or MEAN */
    const Experiment *experiment;
    int64_t sensor_values;     /* that follow the parameters: 0, or the inputs' delay, and each output's gain, offset
                                  and delay */
    int64_t even_steps;        /* the FMU takes steps of one size only */
    int64_t settings;
    const Setting *setting;    /* [settings], set before every initialisation */
    const double *scale;       /* [outputs][2]: factor and offset from the FMU's units to SI, or NULL */
    const int64_t *linear;     /* [inputs]: whether it goes linearly from row to row; NULL: all are held */
} Job;

/* One batch of candidates, in memory that several workers share: each takes the next candidate until none is left. */
typedef struct {
    _Atomic int64_t *next;     /* index of the next candidate to take */
    int64_t *claim;            /* this worker's candidate now; -1: none */
    int64_t candidates;
    int64_t quota;             /* return after this many, so that the worker can look after itself */
    int64_t refine;            /* communication steps are this many times finer than the experiments say */
    const double *values;      /* [candidates][experiments][parameters] */
    const double *bounds;      /* [candidates] */
    double *costs;             /* [candidates]; infinity unless FINISHED */
    int64_t *steps;            /* [candidates] communication steps done */
    int64_t *outcomes;         /* [candidates]: outcome + 256 phase + 65536 FMI status + 2^24 refused variable */
    double *shown;             /* [candidates][samples of all experiments][outputs], or NULL */
} Batch;

typedef struct {
    fenv_t environment;
    unsigned int control;
} FloatingPoint;

static void remember(FloatingPoint *saved) {
    (void)fegetenv(&saved->environment);
#if defined(__SSE2__)
    saved->control = _mm_getcsr() & SSE_CONTROL_BITS;
#else
    saved->control = (unsigned int)fegetround();
#endif
}

static int is_changed(const FloatingPoint *saved) {
    const char *numeric;
#if defined(__SSE2__)
    if ((_mm_getcsr() & SSE_CONTROL_BITS) != saved->control) return 1;
#else
    if ((unsigned int)fegetround() != saved->control) return 1;
#endif
    numeric = setlocale(LC_NUMERIC, NULL);
    return numeric != NULL && strcmp(numeric, "C") != 0;
}

static void restore(const FloatingPoint *saved) {
    (void)fesetenv(&saved->environment);
    (void)setlocale(LC_NUMERIC, "C");
}

/* Called by the FMU. Native, since a Python callback would take the interpreter's lock for every message. */
EXPORT void stepper_log(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    Log *log = environment;
    va_list arguments;
    (void)instance;
    (void)category;
    if (log == NULL || message == NULL) return;
    log->messages++;
    if (status < fmi2Discard) return;
    va_start(arguments, message);
    (void)vsnprintf(log->last, sizeof log->last, message, arguments);
    va_end(arguments);
}

/* The same for FMI 1.0, whose loggers are not told whose log it is. */
EXPORT void stepper_log1(void *component, const char *instance, int status, const char *category, const char *message,
                         ...) {
    (void)component, (void)instance, (void)status, (void)category, (void)message;
}

/* The same for FMI 3.0. */
EXPORT void stepper_log3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                         fmi3String message) {
    Log *log = environment;
    (void)category;
    if (log == NULL || message == NULL) return;
    log->messages++;
    if (status >= fmi3Discard) (void)snprintf(log->last, sizeof log->last, "%s", message);
}

/* Fill in the functions of FMI 3.0 in the shape of FMI 2.0. */
EXPORT void stepper_adapt(Fmu *fmu, const Fmi3 *fmi) {
    fmu->instantiate = adapted_instantiate;
    fmu->free_instance = adapted_free;
    fmu->reset = adapted_reset;
    fmu->setup_experiment = adapted_setup;
    fmu->enter_initialization = adapted_enter;
    fmu->exit_initialization = adapted_exit;
    fmu->set_real = adapted_set;
    fmu->get_real = adapted_get;
    fmu->do_step = adapted_step;
    fmu->set_other = adapted_set_other;
    fmu->callbacks = (const fmi2CallbackFunctions *)(const void *)fmi;
}

/* In place of a function that an FMU lacks: Error. */
EXPORT int stepper_missing(void) { return fmi2Error; }

/* Fill in an FMU for model exchange of any version, or one for co-simulation of FMI 1.0, in the same shape. */
EXPORT void stepper_exchange(Fmu *fmu, Equations *equations) {
    fmu->instantiate = exchange_instantiate;
    fmu->free_instance = exchange_free;
    fmu->reset = exchange_reset;
    fmu->setup_experiment = exchange_setup;
    fmu->enter_initialization = exchange_enter;
    fmu->exit_initialization = exchange_exit;
    fmu->set_real = exchange_set;
    fmu->get_real = exchange_get;
    fmu->do_step = exchange_step;
    fmu->set_other = exchange_set_other;
    fmu->callbacks = (const fmi2CallbackFunctions *)(const void *)equations;
    if (equations->is_model) fmu->horizon = &equations->horizon;
}

static fmi2Status set_setting(const Fmu *fmu, const Setting *setting) {
    const fmi2ValueReference reference = (fmi2ValueReference)setting->reference;
    const int value = (int)setting->whole;
    if (fmu->set_other != NULL) return fmu->set_other(fmu->component, setting);
    if (setting->type == WHOLE) return fmu->set_integer(fmu->component, &reference, 1, &value);
    if (setting->type == TRUTH) return fmu->set_boolean(fmu->component, &reference, 1, &value);
    if (setting->type == TEXT) return fmu->set_string(fmu->component, &reference, 1, &setting->text);
    return fmi2Error;
}

/* A status that FMI does not know keeps its last byte. */
static int64_t failed(int64_t phase, fmi2Status status) {
    return FAILED + 256 * phase + 65536 * ((int64_t)status & 255);
}

static int is_fatal(int64_t outcome) { return outcome % 256 == FAILED && outcome / 65536 % 256 == fmi2Fatal; }

/* Setting values has failed: try them one by one, and say which is refused, counted from `first` + 1; none: 0. */
static int64_t refused(const Fmu *fmu, const fmi2ValueReference references[], int64_t count, const double values[],
                       fmi2Status status, int64_t first) {
    const int64_t outcome = failed(IN_SET, status);
    for (int64_t k = 0; k < count && status != fmi2Fatal; k++) {
        status = fmu->set_real(fmu->component, references + k, 1, values + k);
        if (status > fmi2Warning) return outcome + ((int64_t)1 << 24) * (first + k + 1);
    }
    return outcome;
}

/* The last sample's inputs hold for one interval more: an FMU whose stop time is kept has room for rounding. */
static double stop_time(const Experiment *experiment) {
    if (experiment->times != NULL) return experiment->times[experiment->samples - 1] + experiment->interval;
    return experiment->start + (double)experiment->samples * experiment->interval;
}

static int64_t initialise(Fmu *fmu, const Job *job, const Experiment *experiment, const double *values) {
    fmi2Status status;
    if (fmu->reinstantiate || fmu->component == NULL) {
        if (fmu->component != NULL) fmu->free_instance(fmu->component);
        fmu->component = fmu->instantiate(fmu->instance_name, fmi2CoSimulation, fmu->guid, fmu->resources,
                                              fmu->callbacks, fmi2False, fmi2False);
        if (fmu->component == NULL) return failed(IN_INSTANTIATE, fmi2Error);
    } else if ((status = fmu->reset(fmu->component)) > fmi2Warning) {
        return failed(IN_RESET, status);
    }
    status = fmu->setup_experiment(fmu->component, fmi2False, 0.0, experiment->start, fmi2True,
                                     stop_time(experiment));
    if (status > fmi2Warning) return failed(IN_SETUP, status);
    if (job->parameters > 0) {
        status = fmu->set_real(fmu->component, job->parameter_references, (size_t)job->parameters, values);
        if (status > fmi2Warning)
            return refused(fmu, job->parameter_references, job->parameters, values, status, 0);
    }
    for (int64_t s = 0; s < job->settings; s++) {
        status = set_setting(fmu, &job->setting[s]);
        if (status > fmi2Warning) return failed(IN_SET, status) + ((int64_t)1 << 24) * (job->parameters + s + 1);
    }
    status = fmu->enter_initialization(fmu->component);
    if (status > fmi2Warning) return failed(IN_INITIALISATION, status);
    status = fmu->exit_initialization(fmu->component);
    if (status > fmi2Warning) return failed(IN_INITIALISATION, status);
    return FINISHED;
}

/* What a simulation needs at every step, and where it stands. */
typedef struct {
    const Fmu *fmu;
    const Job *job;
    const Experiment *experiment;
    const FloatingPoint *saved;
    int64_t substeps;
    double h;          /* s, communication step */
    double bound;
    double cost;       /* so far */
    int64_t count;     /* communication steps so far */
    double *shown;     /* NULL: not kept */
    const double *sensor_values;
} Run;

/* Say until when the inputs of sample k hold. */
static void tell_horizon(const Run *run, int64_t k, size_t inputs) {
    const double *now = run->experiment->inputs + (size_t)k * inputs;
    int64_t next = k + 1;
    for (; next < run->experiment->samples; next++) {
        const double *then = run->experiment->inputs + (size_t)next * inputs;
        size_t j = 0;
        while (j < inputs && then[j] == now[j]) j++;
        if (j < inputs) break;
    }
    *run->fmu->horizon = run->experiment->start + (double)next * run->experiment->interval;
}

/* Set the inputs of sample k, where they differ from those of the sample before. */
static inline fmi2Status set_inputs(const Run *run, int64_t k, size_t inputs) {
    const double *now = run->experiment->inputs + (size_t)k * inputs;
    int changed = k == 0;
    for (size_t j = 0; j < inputs && !changed; j++) changed = now[j] != *(now + j - inputs);
    if (changed && run->fmu->horizon != NULL) tell_horizon(run, k, inputs);
    return changed ? run->fmu->set_real(run->fmu->component, run->job->input_references, inputs, now) : fmi2OK;
}

#include "timed.h"

/* Inlined into each call, so that constant arguments take the questions out of the loop. */
#if defined(__GNUC__)
#define SPECIALISED static inline __attribute__((always_inline))
#else
#define SPECIALISED static inline
#endif

/* What a loop leaves out: PLAIN is for outputs that are shown as they are, but for a gain and an offset, BARE for those
   of complete recordings whose trajectories are not kept. The same sums in the same order, without the questions. */
enum { WHOLE_CHAIN, PLAIN, BARE };

/* Step and compare. */
SPECIALISED int64_t follow(Run *run, const size_t outputs, const size_t inputs, const int how) {
    const Fmu *fmu = run->fmu;
    const Job *job = run->job;
    const Experiment *experiment = run->experiment;
    const fmi2Component component = fmu->component;
    const fmi2ValueReference *references = job->output_references;
    fmi2GetRealTYPE *const get_real = fmu->get_real;
    fmi2DoStepTYPE *const do_step = fmu->do_step;
    const int64_t last = experiment->samples - 1;
    const int bare = how == BARE, plain = how != WHOLE_CHAIN;
    const int64_t substeps = plain ? 1 : run->substeps;
    const double *measured = experiment->measured;
    const double start = experiment->start;
    const double h = run->h;
    const double bound = run->bound;
    double weights[MAX_OUTPUTS];
    double read[MAX_OUTPUTS];
    static _Thread_local ChainState states[MAX_OUTPUTS];
    const double *values = bare ? NULL : run->sensor_values;
    double *shown = bare ? NULL : run->shown;
    double running = run->cost;
    int64_t outcome = FINISHED;
    int64_t count = 0;
    memcpy(weights, experiment->weights, outputs * sizeof *weights);
    for (int64_t k = 0;; k++) {
        fmi2Status status = get_real(component, references, outputs, read);
        if (status > fmi2Warning) {
            outcome = failed(IN_READ, status);
            break;
        }
        for (size_t j = 0; j < outputs; j++) {
            double value = read[j];
            if (!plain) {
                if (job->scale != NULL) value = value * job->scale[2 * j] + job->scale[2 * j + 1];
                const Chain *chain = experiment->chains != NULL ? experiment->chains + j : NULL;
                value = sensor_shows(chain, &states[j], job->sensors[j], experiment->interval, k, value);
            }
            if (values != NULL) value = values[1 + 3 * j] * value + values[2 + 3 * j];
            if (shown != NULL) *shown++ = value;
            if (bare || !isnan(measured[j])) {
                const double residual = value - measured[j];
                running += weights[j] * (residual * residual);
            }
        }
        measured += outputs;
        if (!(running <= bound)) {
            outcome = isfinite(running) ? CUT_SHORT : NOT_FINITE;
            break;
        }
        if (k == last) break;
        status = set_inputs(run, k, inputs);
        if (status > fmi2Warning) {
            outcome = refused(fmu, job->input_references, job->inputs, experiment->inputs + (size_t)k * inputs,
                              status, job->parameters + job->settings);
            break;
        }
        for (int64_t s = 0; s < substeps; s++) {
            status = do_step(component, start + (double)count * h, h, fmi2True);
            count++;
            if (!plain && fmu->restore_every_step) restore(run->saved);
            if (status > fmi2Warning) break;
        }
        if (status > fmi2Warning) {
            outcome = failed(IN_STEP, status);
            break;
        }
    }
    run->cost = running;
    run->count = count;
    return outcome;
}

static int64_t simulate(Run *run, const double *values, Fmu *fmu) {
    const Job *job = run->job;
    const size_t outputs = (size_t)job->outputs;
    const size_t inputs = (size_t)job->inputs;
    int64_t outcome = initialise(fmu, job, run->experiment, values);
    int plain = run->substeps == 1 && !fmu->restore_every_step && run->experiment->chains == NULL && job->scale == NULL;
    int bare = run->shown == NULL && run->experiment->complete && run->sensor_values == NULL;
    if (outcome != FINISHED) return outcome;
    if (is_timed(run)) return follow_events(run);
    for (size_t j = 0; j < outputs; j++) plain = plain && job->sensors[j] == IDENTITY;
    if (plain && outputs == 2 && inputs == 1) return bare ? follow(run, 2, 1, BARE) : follow(run, 2, 1, PLAIN);
    if (plain) return bare ? follow(run, outputs, inputs, BARE) : follow(run, outputs, inputs, PLAIN);
    return follow(run, outputs, inputs, WHOLE_CHAIN);
}

/* Simulate one experiment of a candidate, whose experiments before it cost `*cost`, and add to it. */
static int64_t one_experiment(Fmu *fmu, const Job *job, const Batch *batch, int64_t index, int64_t e, double *cost,
                              const FloatingPoint *saved) {
    const int64_t stride = job->parameters + job->sensor_values;
    const double *values = batch->values + (index * job->experiments + e) * stride;
    const Experiment *experiment = &job->experiment[e];
    const int64_t substeps = experiment->substeps * batch->refine;
    double *shown = NULL;
    int64_t outcome;
    if (batch->shown != NULL) {
        int64_t rows = 0, before = 0;
        for (int64_t k = 0; k < job->experiments; k++) {
            if (k < e) before += job->experiment[k].samples;
            rows += job->experiment[k].samples;
        }
        shown = batch->shown + (index * rows + before) * job->outputs;
    }
    Run run = {.fmu = fmu,
               .job = job,
               .experiment = experiment,
               .saved = saved,
               .substeps = substeps,
               .h = experiment->interval / (double)substeps,
               .bound = batch->bounds[index],
               .cost = *cost,
               .shown = shown,
               .sensor_values = job->sensor_values > 0 ? values + job->parameters : NULL};
    outcome = simulate(&run, values, fmu);
    *cost = run.cost;
    batch->steps[index] += run.count;
    if (outcome % 256 == FAILED && fmu->component != NULL) {
        /* An FMU is in an undefined state after an error: the next run starts from a new instance. */
        if (!is_fatal(outcome)) fmu->free_instance(fmu->component);
        fmu->component = NULL;
    }
    return outcome;
}

static int64_t finish(const Batch *batch, int64_t index, int64_t outcome, double cost) {
    if (outcome == FINISHED && !isfinite(cost)) outcome = NOT_FINITE;
    batch->costs[index] = outcome == FINISHED ? cost : INFINITY;
    return outcome;
}

static int64_t candidate(Fmu *fmu, const Job *job, const Batch *batch, int64_t index, const FloatingPoint *saved) {
    double cost = 0.0;
    int64_t outcome = FINISHED;
    for (int64_t e = 0; e < job->experiments && outcome == FINISHED; e++) {
        outcome = one_experiment(fmu, job, batch, index, e, &cost, saved);
    }
    return finish(batch, index, outcome, cost);
}

/* The same; what the FMU has changed is restored, and the candidate is simulated again where it may matter. */
static int64_t sound_candidate(Fmu *fmu, const Job *job, const Batch *batch, int64_t index,
                               const FloatingPoint *saved) {
    int64_t outcome = candidate(fmu, job, batch, index, saved);
    if (is_changed(saved)) {
        restore(saved);
        if (!fmu->restore_every_step) {
            fmu->restore_every_step = 1;
            outcome = candidate(fmu, job, batch, index, saved);
            restore(saved);
        }
    }
    return outcome;
}

#include "fits.h"

/* Take the next candidate and return its index; -1: none is left. */
EXPORT int64_t stepper_take(const Batch *batch) {
    int64_t index = atomic_fetch_add(batch->next, 1);
    if (index >= batch->candidates) return -1;
    *batch->claim = index;
    return index;
}

/* Simulate one experiment of one candidate, in a process of its own. The running cost of the experiments before it
   stands in batch->costs[index]; it is added to, and final after the last one. */
EXPORT int64_t stepper_run_one(Fmu *fmu, const Job *job, const Batch *batch, int64_t index, int64_t experiment) {
    FloatingPoint saved;
    double cost = experiment == 0 ? 0.0 : batch->costs[index];
    int64_t outcome;
    if (job->outputs > MAX_OUTPUTS || job->inputs > MAX_INPUTS) return -1;
    fmu->restore_every_step = 1; /* nobody looks again */
    remember(&saved);
    outcome = one_experiment(fmu, job, batch, index, experiment, &cost, &saved);
    batch->costs[index] = cost;
    if (outcome != FINISHED || experiment == job->experiments - 1) outcome = finish(batch, index, outcome, cost);
    batch->outcomes[index] = outcome;
    return outcome;
}

/* Simulate candidates until none is left or the quota is reached; return how many. */
EXPORT int64_t stepper_run(Fmu *fmu, const Job *job, const Batch *batch) {
    FloatingPoint saved;
    int64_t done = 0;
    if (job->outputs > MAX_OUTPUTS || job->inputs > MAX_INPUTS) return -1;
    remember(&saved);
    while (done < batch->quota) {
        int64_t index = stepper_take(batch);
        if (index < 0) break;
        batch->outcomes[index] = sound_candidate(fmu, job, batch, index, &saved);
        *batch->claim = -1;
        done++;
    }
    return done;
}

/* Free the instance, if there is one. */
EXPORT void stepper_close(Fmu *fmu) {
    if (fmu->component != NULL) fmu->free_instance(fmu->component);
    fmu->component = NULL;
}
