/* Changes of mode within a step: dry friction that catches and lets go, a contact that closes. Knows the model's margins
 * and how a step is made, nothing of FMI.
 *
 * A step is made as if the modes lasted. Where a margin is below 0 at its end, or dips below 0 on the way, the first
 * instant at which one is below 0 is found, the step made to there, the modes changed, and the rest made from there.
 * Every point looked at is reached by steps from the last change, none by interpolation: within a mode a linear model
 * stays exact, and the instant of a change is right to rounding.
 *
 * Steps are so short that what swings turns back at most once in one, and is bent upwards while it falls; so is what
 * dies away at two rates. A margin that falls at the start then lies above its tangent until it rises: where the tangent
 * stays above 0, so does the margin, and where it does not, Newton's method closes in upon the first root from before.
 *
 * The inputs are held over a step. Two states that swing into each other, and die away, then come nearest to any margin
 * within their first whole swing: once that has passed without a change, the rest of the step is one. So is a step in
 * which no margin depends on a state.
 */
#include "integrator.c"

#include <string.h>

#define MAX_CHANGES 10000  /* of mode in one communication step */
#define MAX_ROUNDS 100     /* of changes at one instant */
#define MAX_PROBES 200     /* in the search for one instant */
#define WHOLE_SWING 5      /* parts: more than 2 pi / LONGEST_SWING */
#define LONGEST_SWING 1.5  /* rad in one step: before its lowest point, a sine is bent upwards for a quarter turn */
#define SLOPE_REACH 0.01   /* of a step: how far a margin is followed to see its slope */
#define SETTLED 1e-6       /* of what a margin has fallen: a slope that is smaller may be that of a state at rest */
#define SHORT 1.0          /* of a step times the rate: below, a series is as exact as an exponential, and cheaper */
#define MAX_TERMS 30       /* of that series */

/* For models without modes, these are empty and all below is left out by the compiler. */
static inline void model_switches(const Values *values, Margins *margins)
{
#if MODEL_MODES > 0
    switches(&values->named, &margins->named);
#else
    (void)values;
    (void)margins;
#endif
}

static inline void model_enter(Values *values)
{
#if MODEL_MODES > 0
    enter(&values->named);
#else
    (void)values;
#endif
}

/* Change modes until no margin is below 0; false if there is no end to it. *changed is set where one has changed;
   margins are those at the end. */
static bool modes_settle(Values *values, Margins *margins, bool *changed)
{
    for (int round = 0; round < MAX_ROUNDS; round++) {
        bool settled = true;
        model_switches(values, margins);
        for (int k = 0; k < N_MODES; k++)
            if (margins->flat[k].margin < 0) {
                values->flat[model_mode_places[k]] = margins->flat[k].next;
                settled = false;
            }
        if (settled) return true;
        model_enter(values);
        *changed = true;
    }
    return false;
}

static double margin_of(int mode, const Values *values)
{
    Margins margins;
    model_switches(values, &margins);
    return margins.flat[mode].margin;
}

/* How fast the margins change, per s, where they are margins; reach in s. */
static void margin_slopes(const Values *values, const Margins *margins, double reach, double *slopes)
{
    Values probe = *values;
    Rates rates;
    Margins ahead;
    derivatives(&values->named, &rates.named);
    for (int i = 0; i < N_STATES; i++) probe.flat[model_state_places[i]] += reach * rates.flat[i];
    model_switches(&probe, &ahead);
    for (int k = 0; k < N_MODES; k++) slopes[k] = (ahead.flat[k].margin - margins->flat[k].margin) / reach;
}

/* For a matrix and parts of the step, of which nothing is computed yet. */
static void flow_begin(Flow *flow, const Matrix *a, double part)
{
    flow->part = part;
    flow->a = *a;
    flow->rate = 0;
    for (int i = 0; i < N_STATES; i++) {
        double sum = 0;
        for (int j = 0; j < N_STATES; j++) sum += sqrt(fabs(a->at[i][j] * a->at[j][i]));
        flow->rate = larger_of(flow->rate, sum);
    }
    for (int k = 0; k < HALVES; k++) flow->known[k] = false;
}

/* Make ready for part / 2^k; false if what is needed is not finite. */
static bool flow_know(Flow *flow, int k)
{
    flow->known[k] = flow->known[k] || propagation(&flow->a, ldexp(flow->part, -k), &flow->growth[k], &flow->gain[k]);
    return flow->known[k];
}

/* Steps of part, part / 2, ... from values, as long as one is within what is left, which is short then, or needs them
   finer; false if what is needed is not finite. */
static bool flow_halve(Flow *flow, double *left, Values *values)
{
    Values at_zero = *values;
    Rates rates;
    double x[N_STATES], grown[N_STATES], held[N_STATES];
    double half = flow->part;
    for (int i = 0; i < N_STATES; i++) at_zero.flat[model_state_places[i]] = 0;
    derivatives(&at_zero.named, &rates.named);
    for (int i = 0; i < N_STATES; i++) x[i] = values->flat[model_state_places[i]];
    for (int k = 0; k < HALVES && *left * flow->rate > SHORT; k++, half /= 2) {
        if (*left < half) continue;
        if (!flow_know(flow, k)) return false;
        matrix_apply(&flow->growth[k], x, grown);
        matrix_apply(&flow->gain[k], rates.flat, held);
        for (int i = 0; i < N_STATES; i++) x[i] += grown[i] + held[i];
        *left -= half;
    }
    for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = x[i];
    return true;
}

/* x += h x' + h^2/2 A x' + ..., by as many terms as count; false where they do not fall off. */
static bool flow_series(const Flow *flow, double step, Values *values)
{
    Rates rates;
    double x[N_STATES], term[N_STATES], next[N_STATES];
    bool counts = true;
    derivatives(&values->named, &rates.named);
    for (int i = 0; i < N_STATES; i++) {
        x[i] = 0;
        term[i] = step * rates.flat[i];
    }
    for (int n = 2; counts; n++) {
        if (n > MAX_TERMS) return false;
        counts = false;
        matrix_apply(&flow->a, term, next);
        for (int i = 0; i < N_STATES; i++) {
            x[i] += term[i];
            term[i] = next[i] * step / n;
            if (!(fabs(term[i]) <= 0.125 * DBL_EPSILON * fabs(x[i]))) counts = true;
        }
    }
    for (int i = 0; i < N_STATES; i++) {
        x[i] += values->flat[model_state_places[i]];
        if (!isfinite(x[i])) return false;
    }
    for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = x[i];
    return true;
}

/* A step of any length, the modes kept; false if it does not end in a finite state. */
static bool modes_keep(Flow *flow, const Values *from, double step, Values *to)
{
    *to = *from;
    if (MODEL_LINEAR) {
        Propagator passing;
        double left = step;
        if (!flow_halve(flow, &left, to)) return false;
        if (left * flow->rate <= SHORT && flow_series(flow, left, to)) return true;
        return propagator_prepare_for(&passing, &flow->a, to, left) && propagator_step(&passing, to);
    } else {
        double substep = 0;
        return rosenbrock_integrate(to, step, &substep);
    }
}

/* An instant in (0, *end] at which a margin that is not below 0 at from and at *end is below 0: in *end, its state in
   *at_end. False: none. No root lies before that of the tangent; twice as far lies the lowest point, where it touches 0. */
static bool margin_dips(int mode, Flow *flow, const Values *from, const Margins *margins, double slope, Values *at_end,
                        const Margins *end_margins, double *end)
{
    double slopes[N_MODES + 1];
    double margin = margins->flat[mode].margin;
    double t = 0, rises = *end;
    bool twice = true;
    Values now = *from;
    if (margin + slope * *end >= 0) return false;
    margin_slopes(at_end, end_margins, SLOPE_REACH * *end, slopes);
    if (slopes[mode] * *end < -SETTLED * fabs(end_margins->flat[mode].margin - margin)) return false; /* it falls all the way */
    for (int n = 0; n < MAX_PROBES && slope < 0 && margin + slope * (rises - t) < 0; n++) {
        const double to = fmin(t - (twice ? 2 : 1) * margin / slope, rises);
        Values there;
        Margins probed;
        if (!(to > t) || !modes_keep(flow, &now, to - t, &there)) break;
        model_switches(&there, &probed);
        if (probed.flat[mode].margin < 0) {
            *end = to;
            *at_end = there;
            return true;
        }
        margin_slopes(&there, &probed, SLOPE_REACH * (to - t), slopes);
        if (slopes[mode] < 0) {
            t = to, now = there, margin = probed.flat[mode].margin, slope = slopes[mode];
            twice = true;
        } else if (twice) {
            rises = to;
            twice = false;
        } else {
            break;
        }
    }
    return false;
}

/* The first instant in (0, end] at which a margin is below 0, to the last bits: false position with halved weights
   (Dowell and Jarratt, BIT 11, 1971), halving where that gets nowhere; *at_end, the state at end, becomes that of the
   instant. Infinite: there is none. */
static double margin_ends(int mode, Flow *flow, const Values *from, const Margins *margins, double slope,
                          Values *at_end, const Margins *end_margins, double end)
{
    double low = 0, high = end;
    double low_margin = margins->flat[mode].margin, high_margin = end_margins->flat[mode].margin;
    Values at_low = *from;
    int side = 0;
    if (!(high_margin < 0)) {
        Values there = *at_end;
        if (!margin_dips(mode, flow, from, margins, slope, &there, end_margins, &high)) return INFINITY;
        high_margin = margin_of(mode, &there);
        *at_end = there;
    }
    for (int n = 0; n < MAX_PROBES && high - low > 4 * DBL_EPSILON * high; n++) {
        double t = low + (high - low) * (low_margin / (low_margin - high_margin));
        double margin;
        Values there;
        if (!(t > low && t < high) || n > MAX_PROBES / 4) t = low + (high - low) / 2;
        if (!(t > low && t < high) || !modes_keep(flow, &at_low, t - low, &there)) break;
        margin = margin_of(mode, &there);
        if (margin < 0) {
            high = t, high_margin = margin, *at_end = there;
            if (side < 0) low_margin /= 2;
            side = -1;
        } else {
            low = t, low_margin = margin, at_low = there;
            if (side > 0) high_margin /= 2;
            side = 1;
        }
    }
    return high;
}

/* How fast the model swings at most, rad/s: by the states that drive each other to and fro, in pairs. Two states alone, of
   a linear model, do not swing where the one's own motion dies away much faster than the other's; among more, what dies
   away at several rates may turn back as often as what swings. */
static double swing(const Matrix *a)
{
    double fastest = 0;
    int coupled = 0;
    for (int i = 0; i < N_STATES; i++) {
        bool drives = false, driven = false;
        for (int j = 0; j < N_STATES; j++) {
            drives = drives || (j != i && a->at[j][i] != 0);
            driven = driven || (j != i && a->at[i][j] != 0);
        }
        coupled += drives && driven;
    }
    for (int i = 0; i < N_STATES; i++) {
        double sum = 0;
        for (int j = 0; j < N_STATES; j++) {
            const double apart = coupled > 2 || !MODEL_LINEAR ? 0 : 0.5 * (a->at[i][i] - a->at[j][j]);
            if (j != i) sum += sqrt(larger_of(0, -a->at[i][j] * a->at[j][i] - apart * apart));
        }
        fastest = larger_of(fastest, sum);
    }
    return fastest;
}

/* Whether no later swing comes nearer to a margin than the first: of a linear model, two states alone swing, and die away,
   and no margin that may end depends on another state. */
static bool swings_die_away(const Matrix *a, const Values *values, const Margins *margins)
{
    double growth = 0;
    int coupled = 0;
    if (!MODEL_LINEAR) return false;
    for (int i = 0; i < N_STATES; i++) {
        bool drives = false, driven = false;
        Values probe = *values;
        Margins probed;
        for (int j = 0; j < N_STATES; j++) {
            drives = drives || (j != i && a->at[j][i] != 0);
            driven = driven || (j != i && a->at[i][j] != 0);
        }
        if (drives && driven) {
            coupled++;
            growth += a->at[i][i];
            continue;
        }
        probe.flat[model_state_places[i]] += model_table[model_state_places[i]].nominal;
        model_switches(&probe, &probed);
        for (int k = 0; k < N_MODES; k++)
            if (margins->flat[k].lasts == 0 && probed.flat[k].margin != margins->flat[k].margin) return false;
    }
    return coupled == 2 && growth <= 0;
}

/* Make ready for a part of the step; what was computed for modes of late may serve again. */
static bool modes_prepare_part(Propagator *propagator, const Matrix *a, const Values *values, double part)
{
    Flow *flow = NULL;
    for (int k = 0; k < FLOWS && flow == NULL; k++) {
        flow = &propagator->flows[k];
        if (flow->part != part || memcmp(&flow->a, a, sizeof *a) != 0) flow = NULL;
        propagator->flow = flow != NULL ? k : propagator->flow;
    }
    if (flow == NULL) {
        propagator->flow = (propagator->flow + 1) % FLOWS;
        flow = &propagator->flows[propagator->flow];
        flow_begin(flow, a, part);
    }
    if (!flow_know(flow, 0)) return false;
    propagator->growth = flow->growth[0];
    propagator->gain = flow->gain[0];
    propagator_hold_inputs(propagator, values);
    return true;
}

/* Make ready for parts of a communication step that are short enough, all of it where all modes last; false if what is
   needed is not finite. */
static bool modes_prepare(Propagator *propagator, const Values *values, double step, bool last)
{
    Matrix a;
    double parts;
    if (MODEL_LINEAR)
        linear_matrix(values, &a);
    else
        jacobian_by_differences(values, &a);
    parts = last ? 1 : ceil(larger_of(1, step * swing(&a) / LONGEST_SWING));
    if (!(parts < MAX_CHANGES)) return false;
    if (MODEL_LINEAR && !modes_prepare_part(propagator, &a, values, step / parts)) return false;
    propagator->step = step;
    propagator->part = step / parts;
    propagator->whole = last;
    propagator->once = parts > 2 * WHOLE_SWING && swings_die_away(&a, values, &propagator->margins);
    return true;
}

/* The first instant in (0, h] at which a mode ends; *next, the state at h, becomes that of the instant, *ends its
   margins. Infinite: none ends. */
static double modes_end(Flow *flow, const Values *now, const Margins *margins, Values *next, Margins *ends, double h)
{
    double slopes[N_MODES + 1];
    double first = INFINITY;
    bool sloped = false;
    model_switches(next, ends);
    for (int k = 0; k < N_MODES; k++) {
        Values at_end = *next;
        double end;
        if (margins->flat[k].lasts != 0) continue;
        if (!(ends->flat[k].margin < 0)) {
            if (!sloped) margin_slopes(now, margins, SLOPE_REACH * h, slopes);
            sloped = true;
            if (!(slopes[k] < 0)) continue; /* it does not dip */
        }
        end = margin_ends(k, flow, now, margins, slopes[k], &at_end, ends, h);
        if (!(end < first)) continue;
        h = first = end;
        *next = at_end;
        model_switches(next, ends);
        sloped = false;
    }
    return first;
}

/* A part of a communication step at whose end, and on the way, all modes last, where that is seen at once: false, and
   none made, where it is not. What was computed for the last part must hold for this one. */
static bool modes_pass(Values *values, Propagator *propagator)
{
    const Margins margins = propagator->margins;
    const double part = propagator->part, reach = SLOPE_REACH * part;
    Margins *ends = &propagator->margins;
    double x[N_STATES], slopes[N_MODES + 1];
    bool last = true;
    Rates rates;
    for (int k = 0; k < N_MODES; k++) last = last && margins.flat[k].lasts != 0;
    if (last) return propagator_step(propagator, values);
    derivatives(&values->named, &rates.named);
    for (int i = 0; i < N_STATES; i++) {
        double *state = &values->flat[model_state_places[i]];
        x[i] = *state;
        *state += reach * rates.flat[i];
    }
    model_switches(values, ends);
    for (int k = 0; k < N_MODES; k++) slopes[k] = (ends->flat[k].margin - margins.flat[k].margin) / reach;
    for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = x[i];
    if (propagator_step(propagator, values)) {
        last = true;
        model_switches(values, ends);
        for (int k = 0; k < N_MODES; k++)
            last = last && (margins.flat[k].lasts != 0 ||
                            (!(ends->flat[k].margin < 0) && !(margins.flat[k].margin + slopes[k] * part < 0)));
        if (last) return true;
        for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = x[i];
    }
    *ends = margins;
    return false;
}

/* The rest of a communication step after a whole swing in which no mode has changed: false, and none made, where a margin
   is below 0 at its end. */
static bool modes_rest(Values *values, Propagator *propagator, double left)
{
    const Matrix a = propagator->flows[propagator->flow].a;
    const double part = propagator->part;
    Values next = *values;
    Margins ends;
    bool done = modes_prepare_part(propagator, &a, values, left) && propagator_step(propagator, &next);
    if (done) {
        model_switches(&next, &ends);
        for (int k = 0; k < N_MODES; k++) done = done && !(ends.flat[k].margin < 0);
    }
    if (done) {
        *values = next;
        propagator->margins = ends;
    }
    return modes_prepare_part(propagator, &a, values, part) && done;
}

/* One communication step through all changes of mode. False, and none made, where it does not end in a finite state or
   modes change without end. */
static bool modes_integrate(Values *values, double step, Propagator *propagator)
{
    Values now = *values;
    Margins *margins = &propagator->margins;
    double left = step;
    bool changed = false;
    bool last = true;
    int calm = 0; /* parts since the last change of mode */
    const bool settled = MODEL_LINEAR && propagator->step == step && propagator->settled;
    if (!settled && !modes_settle(&now, margins, &changed)) return false;
    if (changed) propagator->step = NAN;
    for (int k = 0; k < N_MODES; k++) last = last && margins->flat[k].lasts != 0;
    const bool whole = last; /* no margin depends on a state */
    if (whole != propagator->whole) propagator->step = NAN;
    for (int changes = 0; left > 0 && changes < MAX_CHANGES;) {
        Values next;
        Margins ends;
        double first, h;
        if ((!MODEL_LINEAR || !(propagator->step == step)) && !modes_prepare(propagator, &now, step, whole)) return false;
        Flow *const flow = &propagator->flows[propagator->flow];
        h = propagator->part < left * (1 - 1e-12) ? propagator->part : left;
        if (MODEL_LINEAR && fabs(h - propagator->part) <= 1e-12 * step && modes_pass(&now, propagator)) {
            left -= h;
            calm++;
            if (propagator->once && calm == WHOLE_SWING && left > h && modes_rest(&now, propagator, left)) left = 0;
            continue;
        }
        calm++;
        if (!modes_keep(flow, &now, h, &next)) return false;
        first = modes_end(flow, &now, margins, &next, &ends, h);
        now = next;
        left -= first < h ? first : h;
        *margins = ends;
        if (!(first < INFINITY)) continue;
        last = false;
        if (!modes_settle(&now, margins, &changed)) return false;
        propagator->step = NAN;
        calm = 0;
        changes++;
    }
    if (left > 0) return false;
    propagator->lasting = last && propagator->part == step;
    propagator->settled = true;
    *values = now;
    return true;
}
