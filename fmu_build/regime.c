/* What was computed of a linear model, and the steps that need nothing else. Knows the model's matrix and margins, nothing
 * of changes of mode, nor of FMI.
 *
 * Matrix and margins' rates follow from parameters and modes, what a propagation adds from the inputs too. Each is computed
 * when it is first asked for, and kept for the modes and steps of late: a voltage that is pulsed comes back to the same
 * modes, an output that is late makes two steps in turn.
 *
 * Steps are so short that what swings turns back at most once in one, and is bent upwards while it falls; so is what dies
 * away at two rates. A margin that falls at the start then lies above its tangent until it rises. So a step in which no
 * mode ends shows at its end, where no margin is below 0, and at the end of the tangents, where none is either. Margins
 * that are linear in the states are told there by two products each; what is so near to 0 that rounding may matter is
 * left to those who look at the margins themselves.
 */
#include "integrator.c"

#include <string.h>

#define LONGEST_SWING 1.5 /* rad in one step: before its lowest point, a sine is bent upwards for a quarter turn */
#define MOST_PARTS 10000  /* of a communication step */
#define WHOLE_SWING 5     /* parts: more than 2 pi / LONGEST_SWING */
#define NEAR 1e-9         /* of the terms of a margin: what is nearer to 0 may be rounding */

enum {
    KNOWN = 4,                     /* communication steps of late */
    REGIMES = N_MODES > 0 ? 4 : 1, /* sets of modes of late */
    HALVES = N_MODES > 0 ? 20 : 1  /* of a part of a step */
};

/* A communication step, in parts of one length: what is computed for a part, its half, its quarter, ... */
typedef struct {
    double step; /* s; NaN: none */
    double part; /* s: what one propagation covers of it: all, but where the model has modes */
    bool whole;  /* it is for modes of which no state can end one: in one part, however it swings */
    bool once;   /* no swing after the first whole one need be looked at */
    unsigned long inputs;                      /* for which the next three are */
    double change[N_STATES];                   /* gain b */
    double ahead[N_MODES + 1];                 /* tangents at their ends: at x = 0 */
    double terms[N_MODES + 1];                 /* sizes of what they and the margins are sums of */
    double tangents[N_MODES + 1][N_STATES];    /* and what they change with the states */
    Matrix growth[HALVES], gain[HALVES];
    bool known[HALVES];
} Propagator;

/* A set of modes, for the parameters as they are. */
typedef struct {
    bool begun; /* its modes, its matrix and what follows from it are there */
    double modes[N_MODES + 1];
    Matrix a;
    double rate;                             /* 1/s: how fast the states drive each other */
    double rates[N_MODES + 1][N_STATES];     /* what linear margins change with the states */
    unsigned long inputs;                    /* for which the rest is; no mode is to change then */
    double b[N_STATES];                      /* the derivatives at x = 0 */
    int watched[N_MODES + 1], watching;      /* margins that a state can bring to 0, and how many */
    bool told;                               /* they are all linear */
    double least[N_MODES + 1], most[N_MODES + 1]; /* between which their linear quantities are while modes last */
    double offsets[N_MODES + 1];             /* these quantities at x = 0 */
    double terms[N_MODES + 1];               /* sizes of what they are sums of */
    Propagator steps[KNOWN];
    int latest;
} Regime;

/* All that was computed, and which of it holds. */
typedef struct {
    Regime regimes[REGIMES];
    Regime *regime;
    Propagator *propagator; /* of the last step: one of the regime's */
    unsigned long inputs;   /* how many there were */
} Solution;

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

/* What was computed does not follow from the parameters any more. */
static void solution_forget(Solution *s)
{
    for (int k = 0; k < REGIMES; k++) s->regimes[k].begun = false;
    s->regime = s->regimes;
    s->propagator = s->regime->steps;
    s->propagator->step = NAN;
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

/* How fast the states drive each other at most, 1/s. */
static double exchange_rate(const Matrix *a)
{
    double fastest = 0;
    for (int i = 0; i < N_STATES; i++) {
        double sum = 0;
        for (int j = 0; j < N_STATES; j++) sum += sqrt(fabs(a->at[i][j] * a->at[j][i]));
        fastest = larger_of(fastest, sum);
    }
    return fastest;
}

/* Whether no later swing comes nearer to a margin than the first: of a linear model, two states alone swing, and die away,
   and no margin that may end depends on another state. */
static bool swings_die_away(const Matrix *a, const Values *values)
{
    double growth = 0;
    int coupled = 0;
    Margins margins;
    if (!MODEL_LINEAR) return false;
    model_switches(values, &margins);
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
            if (margins.flat[k].lasts == 0 && probed.flat[k].margin != margins.flat[k].margin) return false;
    }
    return coupled == 2 && growth <= 0;
}

/* What linear margins change with the states; inputs, which do not matter, are kept out of the differences. */
static void margin_rates(const Values *values, double rates[N_MODES + 1][N_STATES])
{
    Values probe = *values;
    Margins origin, there;
    for (int k = 0; k < N_VARIABLES; k++)
        if (model_table[k].kind == MODEL_input || model_table[k].kind == MODEL_state) probe.flat[k] = 0;
    model_switches(&probe, &origin);
    for (int j = 0; j < N_STATES; j++) {
        probe.flat[model_state_places[j]] = 1;
        model_switches(&probe, &there);
        probe.flat[model_state_places[j]] = 0;
        for (int k = 0; k < N_MODES; k++) rates[k][j] = there.flat[k].linear - origin.flat[k].linear;
    }
}

/* The regime of the modes as they are. */
static Regime *solution_regime(Solution *s, const Values *values)
{
    Regime *r;
    for (int k = 0; k < REGIMES; k++) {
        bool same = s->regimes[k].begun;
        for (int m = 0; m < N_MODES; m++) same = same && s->regimes[k].modes[m] == values->flat[model_mode_places[m]];
        if (same) return &s->regimes[k];
    }
    r = &s->regimes[(s->regime - s->regimes + 1) % REGIMES];
    for (int m = 0; m < N_MODES; m++) r->modes[m] = values->flat[model_mode_places[m]];
    linear_matrix(values, &r->a);
    if (N_MODES > 0) {
        r->rate = exchange_rate(&r->a);
        margin_rates(values, r->rates);
    }
    for (int k = 0; k < KNOWN; k++) r->steps[k].step = NAN;
    r->latest = 0;
    r->inputs = s->inputs - 1;
    r->begun = true;
    return r;
}

/* With the model's functions inlined, of which much that is not looked at here falls away. */
#if defined(__GNUC__)
#define REGIME_FLATTENED __attribute__((flatten))
#else
#define REGIME_FLATTENED
#endif

/* Make ready for the inputs as they are: b, and which margins to watch; false where a mode is to change at once. */
REGIME_FLATTENED static bool regime_hold(Regime *r, Values *values, unsigned long inputs)
{
    double x[N_STATES];
    Margins margins;
    Rates rates;
    model_switches(values, &margins);
    for (int k = 0; k < N_MODES; k++)
        if (margins.flat[k].margin < 0) return false;
    for (int i = 0; i < N_STATES; i++) {
        double *state = &values->flat[model_state_places[i]];
        x[i] = *state;
        *state = 0;
    }
    derivatives(&values->named, &rates.named);
    for (int i = 0; i < N_STATES; i++) {
        values->flat[model_state_places[i]] = x[i];
        r->b[i] = rates.flat[i];
    }
    r->watching = 0;
    r->told = true;
    for (int k = 0; k < N_MODES; k++) {
        const Switch *margin = &margins.flat[k];
        if (margin->lasts != 0) continue;
        r->watched[r->watching++] = k;
        r->told = r->told && margin->most != 0;
        r->most[k] = margin->most;
        r->least[k] = margin->most < INFINITY ? -margin->most : 0;
        r->offsets[k] = margin->linear;
        r->terms[k] = fabs(margin->linear);
        for (int j = 0; j < N_STATES; j++) {
            const double term = r->rates[k][j] * x[j];
            r->offsets[k] -= term;
            r->terms[k] += fabs(term);
        }
    }
    r->inputs = inputs;
    return true;
}

/* The same for a step. */
static inline void propagator_hold(Propagator *p, const Regime *r)
{
    matrix_apply(&p->gain[0], r->b, p->change);
    for (int n = 0; n < r->watching; n++) {
        const int k = r->watched[n];
        double rate = 0;
        for (int j = 0; j < N_STATES; j++) rate += r->rates[k][j] * r->b[j];
        p->ahead[k] = r->offsets[k] + p->part * rate;
        p->terms[k] = r->terms[k] + fabs(p->part * rate);
    }
    p->inputs = r->inputs;
}

/* Make ready for part / 2^k; false if what is needed is not finite. */
static bool propagator_know(Propagator *p, const Matrix *a, int k)
{
    p->known[k] = p->known[k] || propagation(a, p->part / (1 << k), &p->growth[k], &p->gain[k]);
    return p->known[k];
}

/* Make ready for a communication step, in parts that are short enough, or as a whole; NULL if what is needed is not
   finite. The regime holds for the inputs as they are. */
static Propagator *regime_step(Regime *r, const Values *values, double step, bool whole)
{
    Propagator *p = NULL;
    for (int k = 0; k < KNOWN && p == NULL; k++)
        if (r->steps[k].step == step && r->steps[k].whole == whole) p = &r->steps[k];
    if (p == NULL) {
        double parts = 1;
        if (N_MODES > 0 && !whole) parts = ceil(larger_of(1, step * swing(&r->a) / LONGEST_SWING));
        if (!(parts < MOST_PARTS)) return NULL;
        r->latest = (r->latest + 1) % KNOWN;
        p = &r->steps[r->latest];
        p->step = NAN;
        p->part = step / parts;
        for (int k = 0; k < HALVES; k++) p->known[k] = false;
        if (!propagator_know(p, &r->a, 0)) return NULL;
        for (int k = 0; k < N_MODES; k++)
            for (int j = 0; j < N_STATES; j++) {
                double rate = 0;
                for (int i = 0; i < N_STATES; i++) rate += r->rates[k][i] * r->a.at[i][j];
                p->tangents[k][j] = r->rates[k][j] + p->part * rate;
            }
        p->once = false;
        if (N_MODES > 0) p->once = parts > 2 * WHOLE_SWING && swings_die_away(&r->a, values);
        p->whole = whole;
        p->step = step;
        p->inputs = r->inputs - 1;
    }
    if (p->inputs != r->inputs) propagator_hold(p, r);
    return p;
}

/* Make ready for a communication step, for modes and inputs as they are; false if what is needed is not finite, or a mode
   is to change at once. */
static bool solution_prepare(Solution *s, Values *values, double step, bool whole)
{
    Regime *r = solution_regime(s, values);
    Propagator *p = NULL;
    if (r->inputs == s->inputs || regime_hold(r, values, s->inputs)) p = regime_step(r, values, step, whole);
    if (p == NULL) return false;
    s->regime = r;
    s->propagator = p;
    return true;
}

/* One part of a step, from x to next; false if that is infinite or NaN. Two sums a row: they do not wait for each other. */
static inline bool propagator_apply(const Propagator *p, const double *x, double *next)
{
    double sum;
    for (int i = 0; i < N_STATES; i++) {
        double even = p->growth[0].at[i][0] * x[0];
        double odd = x[i] + p->change[i];
        for (int j = 1; j < N_STATES; j += 2) odd += p->growth[0].at[i][j] * x[j];
        for (int j = 2; j < N_STATES; j += 2) even += p->growth[0].at[i][j] * x[j];
        next[i] = even + odd;
    }
    sum = next[0];
    for (int i = 1; i < N_STATES; i++) sum += next[i];
    return isfinite(sum);
}

static bool propagator_step(const Propagator *p, Values *values)
{
    double x[N_STATES], next[N_STATES];
    for (int i = 0; i < N_STATES; i++) x[i] = values->flat[model_state_places[i]];
    if (!propagator_apply(p, x, next)) return false;
    for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = next[i];
    return true;
}

/* One part of a step in which all modes last, where that is seen at once: false, and none made, where it is not. */
static inline bool regime_pass(const Regime *r, const Propagator *p, Values *values)
{
    double x[N_STATES], next[N_STATES];
    for (int i = 0; i < N_STATES; i++) x[i] = values->flat[model_state_places[i]];
    if (!propagator_apply(p, x, next)) return false;
    for (int n = 0; n < (N_MODES > 0 ? r->watching : 0); n++) {
        const int k = r->watched[n];
        double end = r->offsets[k], ahead = p->ahead[k], terms = p->terms[k];
        for (int j = 0; j < N_STATES; j++) {
            const double one = r->rates[k][j] * next[j], other = p->tangents[k][j] * x[j];
            end += one;
            ahead += other;
            terms += fabs(one) + fabs(other);
        }
        const double low = r->least[k] + NEAR * terms, high = r->most[k] - NEAR * terms;
        if (!(end > low && ahead > low && end < high && ahead < high)) return false;
    }
    for (int i = 0; i < N_STATES; i++) values->flat[model_state_places[i]] = next[i];
    return true;
}

/* The propagator of a step that was made of late, whether for the inputs as they are or not; that of the last step where
   there is none. */
static Propagator *solution_recall(const Solution *s, double step)
{
    Regime *r = s->regime;
    for (int k = 0; k < KNOWN && r->begun; k++)
        if (r->steps[k].step == step && r->steps[k].whole == s->propagator->whole) return &r->steps[k];
    return s->propagator;
}

/* One communication step of which all is known, in which all modes last: false, and none made, where that is not seen at
   once. */
static inline bool solution_step(Solution *s, Values *values, double step)
{
    Regime *r = s->regime;
    if (!(s->propagator->step == step)) s->propagator = solution_recall(s, step);
    Propagator *p = s->propagator;
    if (!(p->step == step)) return false;
    if (p->inputs != s->inputs) {
        if (r->inputs != s->inputs && !regime_hold(r, values, s->inputs)) return false;
        propagator_hold(p, r);
    }
    if (N_MODES > 0 && (p->part != step || !r->told || p->whole != (r->watching == 0))) return false;
    return regime_pass(r, p, values);
}
