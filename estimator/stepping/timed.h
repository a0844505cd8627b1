/* timed: one recording whose times are not those of the steps. Included by stepper.c; knows no FMI version.
 *
 * Inputs that act late by a fraction of a sample, outputs that are shown late, inputs that go linearly from row to row,
 * clocks that jitter: every instant at which an input changes or an output is read is an event, and the FMU is stepped
 * from event to event, exactly, with no interpolation of outputs. An input that goes linearly is held, over each
 * communication step, at its mean there: the error goes with the square of the step (substeps, or `refine`). An FMU
 * that interpolates its inputs is told their slopes instead.
 *
 * An FMU of one step size only cannot be stepped so: it is stepped from sample to sample, its inputs at their means
 * over the step, and what is read between two samples is interpolated linearly.
 */
#ifndef TIMED_H
#define TIMED_H

#include <float.h>
#include <stdlib.h>

#define USUAL 4 /* communication steps that come again: outputs that are late part each interval alike */

typedef struct {
    Run *run;
    size_t inputs;
    size_t outputs;
    int64_t samples;
    double delay;                 /* s, by which inputs act late */
    double late[MAX_OUTPUTS];     /* s, by which outputs are shown late, not negative */
    double same;                  /* s, instants that are nearer than this are one */
    int64_t row;                  /* of the inputs, that acts now; -1: before the first */
    int64_t changing;             /* row of the inputs at which something changes next; `samples`: none */
    double change;                /* s, when it begins to act */
    double lasts;                 /* s, until when the inputs that the FMU holds are right */
    int64_t next[MAX_OUTPUTS];    /* sample of each output to be read next */
    double due[MAX_OUTPUTS];      /* s, when that is; infinity after the last */
    double *kept;                 /* [samples][outputs] as read, each at its own instant */
    double before[MAX_OUTPUTS];   /* even steps: as read a step ago */
    double held[MAX_INPUTS];
    int has_held;
    int goes_linearly;            /* an input does, between its rows */
    int tells_slopes;             /* the FMU is told the slopes of its inputs */
    int is_plain;                 /* where no input changes, a sample is one communication step behind the other */
    double steps[USUAL];          /* s, communication steps of this run; 0: none yet */
    int oldest;                   /* of these */
} Timed;

static inline double instant(const Experiment *experiment, int64_t k) {
    return experiment->times != NULL ? experiment->times[k]
                                     : experiment->start + (double)k * experiment->interval;
}

/* When a row of the inputs begins to act. */
static inline double acts_from(const Timed *t, int64_t row) {
    return instant(t->run->experiment, row) + t->delay;
}

static inline int goes_linearly(const Timed *t, size_t input) {
    return t->run->job->linear != NULL && t->run->job->linear[input];
}

/* Where an input that goes linearly is just before the next row, which is none of the last. */
static inline double ends_at(const Timed *t, int64_t row, size_t input) {
    const Experiment *experiment = t->run->experiment;
    if (experiment->ends != NULL) return experiment->ends[(size_t)row * t->inputs + input];
    return experiment->inputs[(size_t)(row + 1) * t->inputs + input];
}

/* Whether anything changes where a row begins to act. */
static int is_change(const Timed *t, int64_t row) {
    const double *now = t->run->experiment->inputs + (size_t)row * t->inputs;
    for (size_t j = 0; j < t->inputs; j++) {
        if (goes_linearly(t, j)) return 1;
        if (row > 0 && now[j] != *(now + j - t->inputs)) return 1;
    }
    return 0;
}

/* When inputs change next after `now`; times do not go back. */
static double next_change(Timed *t, double now) {
    while (t->change <= now + t->same) {
        t->changing++;
        if (t->changing >= t->samples)
            t->change = INFINITY;
        else if (is_change(t, t->changing))
            t->change = acts_from(t, t->changing);
    }
    return t->change;
}

/* The next event after `now`, at most `end`. */
static double next_event(Timed *t, double now, double end) {
    double event = end;
    const double change = next_change(t, now);
    if (change < event - t->same) event = change;
    for (size_t j = 0; j < t->outputs; j++)
        if (t->due[j] > now + t->same && t->due[j] < event - t->same) event = t->due[j];
    return event;
}

/* Means of the inputs between two instants. */
static void input_means(const Timed *t, double from, double to, double *means) {
    const double *rows = t->run->experiment->inputs;
    const int64_t last = t->samples - 1;
    int64_t row = t->row;
    double left = from;
    while (row < last && acts_from(t, row + 1) <= from + t->same) row++;
    for (size_t j = 0; j < t->inputs; j++) means[j] = 0.0;
    for (int first = 1;; first = 0) {
        const double until = row < last ? acts_from(t, row + 1) : to;
        const double right = until < to - t->same ? until : to;
        const double middle = 0.5 * (left + right);
        const double *now = rows + (size_t)(row < 0 ? 0 : row) * t->inputs;
        for (size_t j = 0; j < t->inputs; j++) {
            double value = now[j];
            if (goes_linearly(t, j) && row >= 0 && row < last) {
                const double begin = acts_from(t, row);
                value += (middle - begin) / (acts_from(t, row + 1) - begin) * (ends_at(t, row, j) - value);
            }
            if (first && right >= to) means[j] = value;
            else means[j] += value * (right - left) / (to - from);
        }
        if (right >= to) return;
        left = right;
        row++;
    }
}

/* Tell the FMU where its inputs begin between two instants without an event between, and how steep they are. */
static fmi2Status tell_slopes(const Timed *t, double from, double to, const double *means) {
    const Fmu *fmu = t->run->fmu;
    const fmi2ValueReference *references = t->run->job->input_references;
    const double *rows = t->run->experiment->inputs;
    const double middle = 0.5 * (from + to);
    double begin[MAX_INPUTS], slope[MAX_INPUTS];
    fmi2ValueReference told[MAX_INPUTS];
    fmi2Integer order[MAX_INPUTS];
    size_t count = 0;
    int64_t row = t->row;
    fmi2Status status;
    while (row + 1 < t->samples && acts_from(t, row + 1) <= middle) row++;
    for (size_t j = 0; j < t->inputs; j++) {
        begin[j] = means[j];
        if (!goes_linearly(t, j)) continue;
        slope[count] = 0.0;
        if (row >= 0 && row + 1 < t->samples) {
            const double *now = rows + (size_t)row * t->inputs + j;
            slope[count] = (ends_at(t, row, j) - *now) / (acts_from(t, row + 1) - acts_from(t, row));
        }
        begin[j] -= 0.5 * slope[count] * (to - from);
        told[count] = references[j];
        order[count++] = 1;
    }
    status = fmu->set_real(fmu->component, references, t->inputs, begin);
    if (status > fmi2Warning) return status;
    return fmu->set_derivatives(fmu->component, told, count, order, slope);
}

static fmi2Status hold_means(Timed *t, double from, double to) {
    const Fmu *fmu = t->run->fmu;
    double means[MAX_INPUTS];
    int changed = !t->has_held;
    if (t->inputs == 0 || to <= t->lasts) return fmi2OK;
    input_means(t, from, to, means);
    if (!t->goes_linearly) {
        const double change = next_change(t, from);
        t->lasts = to <= change + t->same ? change + t->same : -INFINITY;
    }
    if (t->tells_slopes) return tell_slopes(t, from, to, means);
    for (size_t j = 0; j < t->inputs && !changed; j++) changed = means[j] != t->held[j];
    if (!changed) return fmi2OK;
    memcpy(t->held, means, t->inputs * sizeof *means);
    t->has_held = 1;
    return fmu->set_real(fmu->component, t->run->job->input_references, t->inputs, means);
}

/* When the next sample of an output is to be read. */
static inline double due_next(const Timed *t, size_t output) {
    return t->next[output] < t->samples ? instant(t->run->experiment, t->next[output]) - t->late[output] : INFINITY;
}

/* Keep what was read now, for all samples that are due. */
static void keep(Timed *t, const double *read, double now, double a_step_ago) {
    const int even = t->run->job->even_steps && now > a_step_ago;
    for (size_t j = 0; j < t->outputs; j++) {
        while (t->due[j] <= now + t->same) {
            double value = read[j];
            if (even && t->due[j] < now - t->same)
                value = t->before[j] + (t->due[j] - a_step_ago) / (now - a_step_ago) * (value - t->before[j]);
            t->kept[(size_t)t->next[j]++ * t->outputs + j] = value;
            t->due[j] = due_next(t, j);
        }
        t->before[j] = read[j];
    }
}

/* A communication step that differs from an earlier one by the rounding of the times is that one: an FMU has computed
   for it already. */
static double usual_step(Timed *t, double step, double time) {
    const double rounding = 4 * DBL_EPSILON * (fabs(time) + step);
    for (int k = 0; k < USUAL; k++)
        if (fabs(step - t->steps[k]) <= rounding) return t->steps[k];
    t->steps[t->oldest] = step;
    t->oldest = (t->oldest + 1) % USUAL;
    return step;
}

/* Step from one sample to the next, and read on the way what is due. */
static int64_t step_over(Timed *t, int64_t k, int64_t *count) {
    const Run *run = t->run;
    const Fmu *fmu = run->fmu;
    const double begin = instant(run->experiment, k);
    const double end = instant(run->experiment, k + 1);
    double now = begin;
    double read[MAX_OUTPUTS];
    if (t->is_plain && end <= t->lasts) {
        const fmi2Status status = fmu->do_step(fmu->component, begin, usual_step(t, end - begin, begin), fmi2True);
        ++*count;
        return status > fmi2Warning ? failed(IN_STEP, status) : FINISHED;
    }
    while (now < end) {
        const double stop = run->job->even_steps ? end : next_event(t, now, end);
        const double way = stop - now;
        int64_t steps = 1;
        if (stop == end && now == begin) steps = run->substeps;
        else if (way > run->h) steps = (int64_t)ceil(way / run->h - 1e-9);
        const double h = usual_step(t, steps > 1 ? way / (double)steps : way, now);
        fmi2Status status;
        for (int64_t s = 0; s < steps; s++) {
            status = hold_means(t, now + (double)s * h, now + (double)(s + 1) * h);
            if (status > fmi2Warning) return failed(IN_SET, status);
            status = fmu->do_step(fmu->component, now + (double)s * h, h, fmi2True);
            ++*count;
            if (fmu->restore_every_step) restore(run->saved);
            if (status > fmi2Warning) return failed(IN_STEP, status);
        }
        now = stop;
        while (t->row + 1 < t->samples && acts_from(t, t->row + 1) <= now + t->same) t->row++;
        if (now < end) {
            status = fmu->get_real(fmu->component, run->job->output_references, t->outputs, read);
            if (status > fmi2Warning) return failed(IN_READ, status);
            keep(t, read, now, now);
        }
    }
    return FINISHED;
}

/* What the sensors show of sample k, and its share of the cost. */
static double compare(Timed *t, ChainState *states, int64_t k) {
    Run *run = t->run;
    const Job *job = run->job;
    const Experiment *experiment = run->experiment;
    const double interval = k > 0 ? instant(experiment, k) - instant(experiment, k - 1) : experiment->interval;
    double cost = 0.0;
    for (size_t j = 0; j < t->outputs; j++) {
        const Chain *chain = experiment->chains != NULL ? experiment->chains + j : NULL;
        const double measured = experiment->measured[(size_t)k * t->outputs + j];
        double value = t->kept[(size_t)k * t->outputs + j];
        if (job->scale != NULL) value = value * job->scale[2 * j] + job->scale[2 * j + 1];
        value = sensor_shows(chain, &states[j], job->sensors[j], interval, k, value);
        if (run->sensor_values != NULL)
            value = run->sensor_values[1 + 3 * j] * value + run->sensor_values[2 + 3 * j];
        if (run->shown != NULL) *run->shown++ = value;
        if (!isnan(measured)) cost += experiment->weights[j] * ((value - measured) * (value - measured));
    }
    return cost;
}

/* Whether a run needs this loop. */
static int is_timed(const Run *run) {
    const double *values = run->sensor_values;
    if (run->experiment->times != NULL) return 1;
    for (int64_t j = 0; j < run->job->inputs; j++)
        if (run->job->linear != NULL && run->job->linear[j]) return 1;
    if (values == NULL) return 0;
    if (values[0] != 0.0) return 1;
    for (int64_t j = 0; j < run->job->outputs; j++)
        if (values[3 + 3 * j] != 0.0) return 1;
    return 0;
}

/* Step and compare. */
static int64_t follow_events(Run *run) {
    const Fmu *fmu = run->fmu;
    static _Thread_local ChainState states[MAX_OUTPUTS];
    Timed t = {.run = run,
               .inputs = (size_t)run->job->inputs,
               .outputs = (size_t)run->job->outputs,
               .samples = run->experiment->samples,
               .same = 1e-9 * run->experiment->interval,
               .row = -1,
               .changing = -1,
               .change = -INFINITY,
               .lasts = -INFINITY};
    const double start = instant(run->experiment, 0);
    double read[MAX_OUTPUTS];
    double before = start;
    int64_t outcome = FINISHED;
    int64_t count = 0;
    if (run->sensor_values != NULL) {
        t.delay = run->sensor_values[0];
        for (size_t j = 0; j < t.outputs; j++) t.late[j] = run->sensor_values[3 + 3 * j];
    }
    for (size_t j = 0; j < t.outputs; j++) t.due[j] = due_next(&t, j);
    for (size_t j = 0; j < t.inputs; j++) t.goes_linearly = t.goes_linearly || goes_linearly(&t, j);
    t.tells_slopes = t.goes_linearly && fmu->set_derivatives != NULL;
    if (run->job->even_steps) t.tells_slopes = 0; /* an input may bend within a step */
    t.is_plain = run->substeps == 1 && !fmu->restore_every_step && !run->job->even_steps;
    for (size_t j = 0; j < t.outputs; j++) t.is_plain = t.is_plain && t.late[j] == 0.0;
    t.kept = malloc((size_t)t.samples * t.outputs * sizeof *t.kept);
    if (t.kept == NULL) return failed(IN_READ, fmi2Error);
    while (t.row + 1 < t.samples && acts_from(&t, t.row + 1) <= start + t.same) t.row++;
    for (int64_t k = 0;; k++) {
        const double now = instant(run->experiment, k);
        fmi2Status status = fmu->get_real(fmu->component, run->job->output_references, t.outputs, read);
        if (status > fmi2Warning) {
            outcome = failed(IN_READ, status);
            break;
        }
        keep(&t, read, now, before);
        before = now;
        run->cost += compare(&t, states, k);
        if (!(run->cost <= run->bound)) {
            outcome = isfinite(run->cost) ? CUT_SHORT : NOT_FINITE;
            break;
        }
        if (k == t.samples - 1) break;
        outcome = step_over(&t, k, &count);
        if (outcome != FINISHED) break;
    }
    free(t.kept);
    run->count = count;
    return outcome;
}

#endif
