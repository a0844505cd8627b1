/* exchange: an FMU's equations, integrated from one communication point to the next, in the shape of co-simulation.
 *
 * Knows equations.h and two solvers, nothing of candidates. The explicit method of dop853.h goes; where stability
 * holds it to small steps over a long stretch, CVode takes over until the next event. Inputs are held over a step;
 * where they jump, that is an event: the FMU is told, and the integration begins anew. It ends where the inputs will
 * jump next, so that no step is thrown away.
 *
 * Event indicators are looked at after every step of the solver and at every communication point; a change of sign
 * (z > 0 or not, as the standard has it) is located within the step by bisection and the secant. Steps of the solver
 * are its own affair: the FMU is told of a completed step at communication points and at events.
 */
#ifndef EXCHANGE_H
#define EXCHANGE_H

#include <stdio.h>
#include <stdlib.h>

#include "equations.h"

enum { MAX_SOLVER_STEPS = 100000, MAX_EVENTS = 10000, MAX_BISECTIONS = 200, STIFF_STEPS = 15, WORDS = 512 };
static const double WORTH_STIFF = 50.0;  /* explicit steps that are left before the inputs jump */
static const double AT_EVENT = 1e-12;    /* relative: an event this near is now */
static const double AT_ROOT = 2e-15;     /* relative to the time */

/* One instance. */
typedef struct {
    Equations *equations;
    void *instance;
    const char *name, *guid, *resources;
    double start, stop;
    int stops, begun, jumped;
    int has_next;
    double next_event;
    size_t states, indicators;
    double *memory;
    double *nominals, *shown;  /* [states] */
    double *before, *after, *between; /* [indicators], where it is, where it goes, on the way */
    double looked;             /* s, where `before` is from */
    Explicit explicit_;
    Bdf bdf;
    int is_stiff;              /* CVode goes now */
    int is_fresh;              /* the solver has not begun since the last event */
} Exchange;

static fmi2Component exchange_instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                          const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                          fmi2Boolean logging) {
    Equations *equations = (Equations *)(uintptr_t)(const void *)callbacks;
    Exchange *x = calloc(1, sizeof *x);
    (void)type, (void)visible;
    if (x == NULL) return NULL;
    x->equations = equations;
    x->name = name;
    x->guid = guid;
    x->resources = resources;
    x->instance = equations_instantiate(equations, name, guid, resources, logging);
    if (x->instance != NULL) return x;
    free(x);
    return NULL;
}

static void exchange_forget(Exchange *x) {
    if (x->bdf.memory != NULL) bdf_close(&x->bdf);
    free(x->memory);
    x->memory = NULL;
    x->begun = x->is_stiff = x->jumped = 0;
}

static void exchange_free(fmi2Component component) {
    Exchange *x = component;
    exchange_forget(x);
    if (x->instance != NULL) CALL(FreeInstance, x->equations->free_instance)(x->instance);
    free(x);
}

static fmi2Status exchange_reset(fmi2Component component) {
    Exchange *x = component;
    const Equations *e = x->equations;
    exchange_forget(x);
    if (e->reset != NULL) return (fmi2Status)CALL(Simple, e->reset)(x->instance);
    CALL(FreeInstance, e->free_instance)(x->instance); /* FMI 1.0 for model exchange has no reset */
    x->instance = equations_instantiate(e, x->name, x->guid, x->resources, 0);
    return x->instance != NULL ? fmi2OK : fmi2Fatal;
}

static fmi2Status exchange_setup(fmi2Component component, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                                 fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    Exchange *x = component;
    (void)tolerance_defined, (void)tolerance;
    x->start = start;
    x->stop = stop;
    x->stops = stop_defined != 0;
    return fmi2OK;
}

static fmi2Status exchange_enter(fmi2Component component) {
    Exchange *x = component;
    return (fmi2Status)equations_enter(x->equations, x->instance, x->start, x->stops, x->stop);
}

/* Say why, and fail. */
static int gives_up(Exchange *x, int status, const char *why) {
    (void)snprintf(x->equations->words, WORDS, "%s", why);
    return status;
}

/* An event has settled, or not. */
static int noted(Exchange *x, int status, const Event *event) {
    if (status == NEVER_SETTLES) return gives_up(x, fmi2Error, "its discrete states do not settle in 100 iterations");
    if (status > fmi2Warning) return status;
    if (event->terminate) return gives_up(x, fmi2Discard, "it ended the simulation");
    x->has_next = event->has_next;
    x->next_event = event->next;
    return 0;
}

/* Take states, their nominal values and the event indicators as they are at t. */
static int look(Exchange *x, double t) {
    const Equations *e = x->equations;
    double *absolute = x->nominals;
    int status = 0;
    x->is_fresh = 1;
    x->is_stiff = 0;
    x->explicit_.t1 = x->looked = t;
    if (x->states > 0) {
        status = get_states(e, x->instance, x->explicit_.x1, x->states);
        if (status > fmi2Warning) return status;
        if (get_nominals(e, x->instance, absolute, x->states) > fmi2Warning) {
            for (size_t i = 0; i < x->states; i++) absolute[i] = 1.0;
        }
        for (size_t i = 0; i < x->states; i++) {
            const double nominal = fabs(absolute[i]);
            absolute[i] = e->tolerance * (nominal > 0.0 && isfinite(nominal) ? nominal : 1.0);
        }
    }
    return x->indicators > 0 ? get_indicators(e, x->instance, x->before, x->indicators) : 0;
}

static fmi2Status exchange_exit(fmi2Component component) {
    Exchange *x = component;
    Equations *e = x->equations;
    Event event;
    size_t states = (size_t)e->states, indicators = (size_t)e->indicators;
    int status = equations_exit(e, x->instance, x->start, x->stops, x->stop, &event);
    status = noted(x, status, &event);
    if (status > fmi2Warning || !e->is_model) return (fmi2Status)status;
    e->horizon = INFINITY;
    if (e->version == 3) {
        status = (int)CALL(fmi3GetNumberOfContinuousStatesTYPE, e->count_states)(x->instance, &states);
        if (status > fmi2Warning) return (fmi2Status)status;
        indicators = 0;
        if (e->count_indicators != NULL)
            status = (int)CALL(fmi3GetNumberOfEventIndicatorsTYPE, e->count_indicators)(x->instance, &indicators);
        if (status > fmi2Warning) return (fmi2Status)status;
    }
    x->states = states;
    x->indicators = indicators;
    x->memory = calloc((2 + EXPLICIT_ARRAYS) * states + 3 * indicators + 1, sizeof *x->memory);
    if (x->memory == NULL) return fmi2Error;
    x->nominals = x->memory;
    x->shown = x->memory + states;
    x->before = x->memory + (2 + EXPLICIT_ARRAYS) * states;
    x->after = x->before + indicators;
    x->between = x->after + indicators;
    explicit_place(&x->explicit_, states, x->memory + 2 * states);
    x->explicit_.absolute = x->nominals;
    x->explicit_.relative = e->tolerance;
    x->begun = 1;
    return (fmi2Status)look(x, x->start);
}

/* x' = f(t, x), as the solvers see it: status 0, or what the FMU said. */
static int exchange_rates(void *context, double t, const double *states, double *slope) {
    Exchange *x = context;
    int status = set_time(x->equations, x->instance, t);
    if (status <= fmi2Warning && x->states > 0) {
        status = set_states(x->equations, x->instance, states, x->states);
        if (status <= fmi2Warning) status = get_derivatives(x->equations, x->instance, slope, x->states);
    }
    return status > fmi2Warning ? status : 0;
}

/* One step of the solver, not beyond `most`. */
static int solver_step(Exchange *x, double most) {
    Explicit *s = &x->explicit_;
    const Sundials *sundials = &x->equations->sundials;
    if (x->is_stiff) {
        const int status = bdf_step(&x->bdf, most);
        return status == 3 && x->bdf.status == 0 ? gives_up(x, fmi2Error, "CVode cannot integrate its equations")
                                                  : status;
    }
    if (x->is_fresh) {
        const int status = explicit_begin(s, exchange_rates, x, s->t1, most - s->t1);
        if (status != 0) return status;
        x->is_fresh = 0;
    }
    if (s->stiff >= STIFF_STEPS && sundials->create != NULL && most - s->t1 > WORTH_STIFF * s->next) {
        s->stiff = 0;
        if (bdf_begin(&x->bdf, sundials, exchange_rates, x, s->t1, s)) {
            x->is_stiff = 1;
            return solver_step(x, most);
        }
    }
    for (double h = s->next;;) {
        const double left = most - s->t1;
        const int lands = h >= left / 1.01;
        double error, next;
        int status = 0;
        if (lands) h = left;
        error = explicit_try(s, exchange_rates, x, h, &status);
        if (error >= 0.0 && error <= 1.0) {
            next = h * explicit_factor(error);
            s->next = lands && next < s->next ? s->next : next;
            if (lands) s->t1 = most;
            return 0;
        }
        if (status != 0 && status != fmi2Discard) return status;
        h *= status != 0 ? 0.25 : explicit_factor(error);
        s->next = h;
        if (h <= 16.0 * DBL_EPSILON * fabs(s->t1) || h < 1e-300)
            return status != 0 ? status : gives_up(x, fmi2Error, "its equations give no finite derivatives, or jump");
    }
}

static double solver_time(const Exchange *x) { return x->is_stiff ? x->bdf.t1 : x->explicit_.t1; }

static int is_near(double a, double b) { return fabs(a - b) <= AT_EVENT * fmax(fmax(fabs(a), fabs(b)), 1e-3); }

/* Bring the FMU to t, within the last step. */
static int bring(Exchange *x, double t) {
    int status = 0;
    if (x->states > 0) {
        const double at = is_near(t, solver_time(x)) ? solver_time(x) : t;
        status = x->is_stiff ? bdf_at(&x->bdf, at, x->shown)
                             : explicit_at(&x->explicit_, exchange_rates, x, at, x->shown);
        if (status != 0) return status;
    }
    status = set_time(x->equations, x->instance, t);
    if (status <= fmi2Warning && x->states > 0) status = set_states(x->equations, x->instance, x->shown, x->states);
    return status > fmi2Warning ? status : 0;
}

/* Whether an indicator has one sign in one array and the other in the other; `share`: how far on the line between them
   it is nil, of the nearest. */
static int differ(const Exchange *x, const double *left, const double *right, double *share) {
    int crossed = 0;
    *share = 1.0;
    for (size_t i = 0; i < x->indicators; i++) {
        if ((left[i] > 0.0) != (right[i] > 0.0)) {
            const double span = left[i] - right[i];
            const double here = span != 0.0 ? left[i] / span : 0.5;
            crossed = 1;
            if (here < *share) *share = here;
        }
    }
    return crossed;
}

static void swap(double **a, double **b) {
    double *kept = *a;
    *a = *b;
    *b = kept;
}

/* Look for an event up to t, where the FMU is now; if there is one, bring the FMU just behind it. */
static int find_event(Exchange *x, double *t, int *found) {
    const Equations *e = x->equations;
    double share, left = x->looked, right = *t;
    int status;
    *found = 0;
    if (x->indicators == 0) return 0;
    status = get_indicators(e, x->instance, x->after, x->indicators);
    if (status > fmi2Warning) return status;
    *found = differ(x, x->before, x->after, &share);
    for (int k = 0; *found && k < MAX_BISECTIONS; k++) {
        const double part = k % 3 == 2 ? 0.5 : fmin(fmax(share, 1e-3), 1.0 - 1e-3);
        const double middle = left + part * (right - left);
        double unused;
        if (right - left <= AT_ROOT * fmax(fabs(right), right - x->looked) || middle <= left || middle >= right) break;
        status = bring(x, middle);
        if (status == 0) status = get_indicators(e, x->instance, x->between, x->indicators);
        if (status > fmi2Warning) return status;
        if (differ(x, x->before, x->between, &unused)) {
            right = middle;
            swap(&x->after, &x->between);
        } else {
            left = middle;
            swap(&x->before, &x->between);
        }
        (void)differ(x, x->before, x->after, &share);
    }
    swap(&x->before, &x->after);
    x->looked = right;
    if (!*found || right == *t) return 0;
    *t = right;
    return bring(x, right);
}

/* Integrate to `goal` or to the first event before it, and bring the FMU there. */
static int advance(Exchange *x, double *t, double goal, int64_t *steps, int *found) {
    double most = x->equations->horizon;
    if (x->has_next && x->next_event > *t) most = fmin(most, x->next_event);
    if (x->stops) most = fmin(most, x->stop);
    most = fmax(most, goal);
    for (*found = 0; *t < goal && !*found;) {
        double target;
        int status = 0;
        if (x->states == 0) {
            x->explicit_.t1 = goal;
        } else if (solver_time(x) <= *t) {
            status = ++*steps > MAX_SOLVER_STEPS ? gives_up(x, fmi2Error, "its equations need more than 100000 steps")
                                                 : solver_step(x, isfinite(most) ? most : goal);
        }
        if (status != 0) return status;
        target = fmin(goal, solver_time(x));
        status = bring(x, target);
        if (status == 0) status = find_event(x, &target, found);
        if (status > fmi2Warning) return status;
        *t = target;
    }
    return 0;
}

/* Let an event happen at t. */
static int happen(Exchange *x, double t) {
    Event event;
    int status = x->jumped ? 0 : enter_event(x->equations, x->instance);
    x->jumped = 0;
    if (status > fmi2Warning) return status;
    status = noted(x, settle(x->equations, x->instance, &event), &event);
    if (status > fmi2Warning) return status;
    status = enter_continuous(x->equations, x->instance);
    return status > fmi2Warning ? status : look(x, t);
}

static fmi2Status exchange_step(fmi2Component component, fmi2Real from, fmi2Real h, fmi2Boolean no_set_state) {
    Exchange *x = component;
    const Equations *e = x->equations;
    const double end = from + h;
    double t = from;
    int64_t steps = 0;
    (void)no_set_state;
    if (!e->is_model) return (fmi2Status)CALL(DoStep1, e->do_step)(x->instance, from, h, 1);
    if (x->jumped) {
        const int status = happen(x, t);
        if (status > fmi2Warning) return (fmi2Status)status;
    }
    for (int events = 0; t < end && !is_near(t, end); events++) {
        const int before_end = x->has_next && t < x->next_event && x->next_event < end && !is_near(x->next_event, end);
        int found = 0, wants = 0, ends = 0;
        int status = advance(x, &t, before_end ? x->next_event : end, &steps, &found);
        if (status > fmi2Warning) return (fmi2Status)status;
        status = completed(e, x->instance, &wants, &ends);
        if (status > fmi2Warning) return (fmi2Status)status;
        if (ends) return (fmi2Status)gives_up(x, fmi2Discard, "it ended the simulation");
        if (wants || found || (x->has_next && is_near(t, x->next_event))) status = happen(x, t);
        if (status > fmi2Warning) return (fmi2Status)status;
        if (events > MAX_EVENTS) return (fmi2Status)gives_up(x, fmi2Error, "its events do not end (10000 in one step)");
    }
    return fmi2OK;
}

static fmi2Status exchange_set(fmi2Component component, const fmi2ValueReference references[], size_t count,
                               const fmi2Real values[]) {
    Exchange *x = component;
    if (x->begun && !x->jumped) {
        const int status = enter_event(x->equations, x->instance);
        if (status > fmi2Warning) return (fmi2Status)status;
        x->jumped = 1;
    }
    return (fmi2Status)set_reals(x->equations, x->instance, references, count, values);
}

static fmi2Status exchange_get(fmi2Component component, const fmi2ValueReference references[], size_t count,
                               fmi2Real values[]) {
    Exchange *x = component;
    return (fmi2Status)get_reals(x->equations, x->instance, references, count, values);
}

static fmi2Status exchange_set_other(fmi2Component component, const Setting *setting) {
    Exchange *x = component;
    return (fmi2Status)set_value(x->equations, x->instance, setting);
}

#endif
