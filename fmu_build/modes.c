/* Changes of mode within a step: dry friction that catches and lets go, a contact that closes. Knows the model's margins
 * and how a step is made, nothing of FMI.
 *
 * A step is made as if the modes lasted. Where a margin is below 0 at its end, or dips below 0 on the way, the first
 * instant at which one is below 0 is found, the step made to there, the modes changed, and the rest made from there.
 * Every point looked at is reached by steps from the last change, none by interpolation: within a mode a linear model
 * stays exact, and the instant of a change is right to rounding.
 *
 * A margin that falls at the start of a part of a step lies above its tangent until it rises (regime.c): where the tangent
 * stays above 0, so does the margin, and where it does not, Newton's method closes in upon the first root from before.
 *
 * The inputs are held over a step. Two states that swing into each other, and die away, then come nearest to any margin
 * within their first whole swing: once that has passed without a change, the rest of the step is one. So is a step in
 * which no margin depends on a state.
 */
#include "regime.c"

#define MAX_CHANGES 10000  /* of mode in one communication step */
#define MAX_ROUNDS 100     /* of changes at one instant */
#define MAX_PROBES 200     /* in the search for one instant */
#define SLOPE_REACH 0.01   /* of a step: how far a margin is followed to see its slope */
#define SETTLED 1e-6       /* of what a margin has fallen: a slope that is smaller may be that of a state at rest */
#define SHORT 1.0          /* of a step times the rate: below, a series is as exact as an exponential, and cheaper */
#define MAX_TERMS 30       /* of that series */

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

/* Steps of part, part / 2, ... from values, as long as one is within what is left, which is short then, or needs them
   finer; false if what is needed is not finite. */
static bool keep_by_halves(const Regime *r, Propagator *p, double *left, Values *values)
{
    double x[N_STATES], grown[N_STATES], held[N_STATES];
    double half = p->part;
    for (int i = 0; i < N_STATES; i++) x[i] = values->flat[model_state_places[i]];
    for (int k = 0; k < HALVES && *left * r->rate > SHORT; k++, half /= 2) {
        if (*left < half) continue;
        if (!propagator_know(p, &r->a, k)) return false;
        matrix_apply(&p->growth[k], x, grown);
        matrix_apply(&p->gain[k], r->b, held);
        for (int i = 0; i < N_STATES; i++) x[i] += grown[i] + held[i];
        *left -= half;
    }
    for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = x[i];
    return true;
}

/* x += h x' + h^2/2 A x' + ..., by as many terms as count; false where they do not fall off. */
static bool keep_by_series(const Matrix *a, double step, Values *values)
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
        matrix_apply(a, term, next);
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

/* x += growth x + gain b, computed for this step alone. */
static bool keep_at_once(const Regime *r, double step, Values *values)
{
    Propagator once;
    once.part = step;
    once.known[0] = false;
    if (!propagator_know(&once, &r->a, 0)) return false;
    matrix_apply(&once.gain[0], r->b, once.change);
    return propagator_step(&once, values);
}

/* A step of any length, the modes kept; false if it does not end in a finite state. */
static bool modes_keep(Solution *s, const Values *from, double step, Values *to)
{
    *to = *from;
    if (MODEL_LINEAR) {
        const Regime *r = s->regime;
        double left = step;
        if (!keep_by_halves(r, s->propagator, &left, to)) return false;
        return (left * r->rate <= SHORT && keep_by_series(&r->a, left, to)) || keep_at_once(r, left, to);
    } else {
        double substep = 0;
        return rosenbrock_integrate(to, step, &substep);
    }
}

/* An instant in (0, *end] at which a margin that is not below 0 at from and at *end is below 0: in *end, its state in
   *at_end. False: none. No root lies before that of the tangent; twice as far lies the lowest point, where it touches 0. */
static bool margin_dips(int mode, Solution *s, const Values *from, const Margins *margins, double slope, Values *at_end,
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
        if (!(to > t) || !modes_keep(s, &now, to - t, &there)) break;
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
static double margin_ends(int mode, Solution *s, const Values *from, const Margins *margins, double slope,
                          Values *at_end, const Margins *end_margins, double end)
{
    double low = 0, high = end;
    double low_margin = margins->flat[mode].margin, high_margin = end_margins->flat[mode].margin;
    Values at_low = *from;
    int side = 0;
    if (!(high_margin < 0)) {
        Values there = *at_end;
        if (!margin_dips(mode, s, from, margins, slope, &there, end_margins, &high)) return INFINITY;
        high_margin = margin_of(mode, &there);
        *at_end = there;
    }
    for (int n = 0; n < MAX_PROBES && high - low > 4 * DBL_EPSILON * high; n++) {
        double t = low + (high - low) * (low_margin / (low_margin - high_margin));
        double margin;
        Values there;
        if (!(t > low && t < high) || n > MAX_PROBES / 4) t = low + (high - low) / 2;
        if (!(t > low && t < high) || !modes_keep(s, &at_low, t - low, &there)) break;
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

/* The first instant in (0, h] at which a mode ends; *next, the state at h, becomes that of the instant, *ends its
   margins. Infinite: none ends. */
static double modes_end(Solution *s, const Values *now, const Margins *margins, Values *next, Margins *ends, double h)
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
        end = margin_ends(k, s, now, margins, slopes[k], &at_end, ends, h);
        if (!(end < first)) continue;
        h = first = end;
        *next = at_end;
        model_switches(next, ends);
        sloped = false;
    }
    return first;
}

/* One part of a step in which all modes last, where that is seen from the margins at its end and their slopes at the start:
   false, and none made, where it is not. What was told of margins spares looking at them. */
static bool modes_pass(Solution *s, Values *values)
{
    const Propagator *p = s->propagator;
    Values next = *values;
    Margins margins, ends;
    double slopes[N_MODES + 1];
    if (s->regime->told && regime_pass(s->regime, p, values)) return true;
    model_switches(values, &margins);
    margin_slopes(values, &margins, SLOPE_REACH * p->part, slopes);
    if (!propagator_step(p, &next)) return false;
    model_switches(&next, &ends);
    for (int k = 0; k < N_MODES; k++) {
        const double ahead = margins.flat[k].margin + slopes[k] * p->part;
        if (margins.flat[k].lasts == 0 && (ends.flat[k].margin < 0 || ahead < 0)) return false;
    }
    *values = next;
    return true;
}

/* The rest of a communication step after a whole swing in which no mode has changed: false, and none made, where a margin
   is below 0 at its end. */
static bool modes_rest(Solution *s, Values *values, double left)
{
    const Propagator *p = regime_step(s->regime, values, left, true);
    Values next = *values;
    Margins ends;
    if (p == NULL || !propagator_step(p, &next)) return false;
    model_switches(&next, &ends);
    for (int k = 0; k < N_MODES; k++)
        if (ends.flat[k].margin < 0) return false;
    *values = next;
    return true;
}

/* Make ready for the modes as they are; the length of a part of the step, or NaN where what is needed is not finite. */
static double modes_prepare(Solution *s, Values *values, double step, bool whole)
{
    if (MODEL_LINEAR) {
        return solution_prepare(s, values, step, whole) ? s->propagator->part : NAN;
    } else {
        Matrix a;
        jacobian_by_differences(values, &a);
        return step / (whole ? 1 : ceil(larger_of(1, step * swing(&a) / LONGEST_SWING)));
    }
}

/* One communication step through all changes of mode. False, and none made, where it does not end in a finite state or
   modes change without end. */
static bool modes_integrate(Solution *s, Values *values, double step)
{
    Values now = *values;
    Margins margins;
    double left = step;
    bool changed = false;
    bool whole = true; /* no margin depends on a state */
    int calm = 0;      /* parts since the last change of mode */
    if (!modes_settle(&now, &margins, &changed)) return false;
    for (int k = 0; k < N_MODES; k++) whole = whole && margins.flat[k].lasts != 0;
    for (int changes = 0; left > 0 && changes < MAX_CHANGES;) {
        const double part = modes_prepare(s, &now, step, whole);
        const double h = part < left * (1 - 1e-12) ? part : left;
        Values next;
        Margins ends;
        double first;
        if (!(part > step / MOST_PARTS)) return false;
        if (MODEL_LINEAR && fabs(h - part) <= 1e-12 * step && modes_pass(s, &now)) {
            left -= h;
            calm++;
            if (s->propagator->once && calm == WHOLE_SWING && left > h && modes_rest(s, &now, left)) left = 0;
            continue;
        }
        calm++;
        if (!modes_keep(s, &now, h, &next)) return false;
        model_switches(&now, &margins);
        first = modes_end(s, &now, &margins, &next, &ends, h);
        now = next;
        left -= first < h ? first : h;
        if (!(first < INFINITY)) continue;
        if (!modes_settle(&now, &margins, &changed)) return false;
        calm = 0;
        changes++;
    }
    if (left > 0) return false;
    *values = now;
    return true;
}
