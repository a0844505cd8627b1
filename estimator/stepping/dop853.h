/* dop853: one step of Dormand and Prince's explicit Runge-Kutta method of order 8, and what lies within it.
 *
 * Knows x' = f(t, x) and nothing else; model_exchange.h says what f is, and when to step. Coefficients, error estimate and
 * dense output: Hairer, Norsett, Wanner: Solving Ordinary Differential Equations I, 2nd ed., II.5, II.6 and the
 * authors' DOP853. A one-step method: it begins again after a jump of an input at the cost of two evaluations, where a
 * multi-step method climbs up from order 1.
 */
#ifndef DOP853_H
#define DOP853_H

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

enum { STAGES = 12, ALL_STAGES = 16, DENSE_TERMS = 7 };

static const double RK_C[ALL_STAGES] = {
    0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25,
    0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0, 0.1, 0.2, 0.7777777777777778};
static const double RK_A[ALL_STAGES][ALL_STAGES] = {
    {0},
    {0.05260015195876773},
    {0.0197250569845379, 0.0591751709536137},
    {0.02958758547680685, 0, 0.08876275643042054},
    {0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792},
    {0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242},
    {0.037109375, 0, 0, 0.17025221101954405, 0.06021653898045596, -0.017578125},
    {0.03709200011850479, 0, 0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023},
    {0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894,
     -43.48988418106996},
    {0.47766253643826434, 0, 0, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423,
     -33.28821096898486, -0.020331201708508627},
    {-0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696,
     22.739487099350505, 2.4936055526796523, -3.0467644718982196},
    {2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996,
     -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636},
    {0.054293734116568765, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199,
     -0.1521609496625161, 0.20136540080403034, 0.04471061572777259},
    {0.056167502283047954, 0, 0, 0, 0, 0, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637,
     0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298},
    {0.03183464816350214, 0, 0, 0, 0, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099, 0, 0,
     -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325},
    {-0.42889630158379194, 0, 0, 0, 0, -4.697621415361164, 7.683421196062599, 4.06898981839711, 0.3567271874552811, 0,
     0, 0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987},
};
static const double RK_E3[STAGES] = {
    -0.18980075407240762, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, -0.4226823213237919,
    -0.1521609496625161, 0.20136540080403034, 0.02265179219836082};
static const double RK_E5[STAGES] = {
    0.01312004499419488, 0, 0, 0, 0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
    -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294};
static const double RK_D[DENSE_TERMS - 3][ALL_STAGES] = {
    {-8.428938276109013, 0, 0, 0, 0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207, 2.117034582445028,
     -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331, 18.148505520854727,
     -9.194632392478356, -4.436036387594894},
    {10.427508642579134, 0, 0, 0, 0, 242.28349177525817, 165.20045171727028, -374.5467547226902, -22.113666853125306,
     7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845, -31.139403219565178,
     -9.35292435884448, 35.81684148639408},
    {19.985053242002433, 0, 0, 0, 0, -387.0373087493518, -189.17813819516758, 527.8081592054236, -11.57390253995963,
     6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508, -60.19669523126412,
     84.32040550667716, 11.99229113618279},
    {-25.69393346270375, 0, 0, 0, 0, -154.18974869023643, -231.5293791760455, 357.6391179106141, 93.40532418362432,
     -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114, 96.32455395918828,
     -39.17726167561544, -149.72683625798564},
};

/* Gives x' at t; 0, or what is handed on to whoever steps. */
typedef int Derivatives(void *context, double t, const double *x, double *slope);

/* One step, from t0 to t1, and where the next is to begin. Arrays of n. */
typedef struct {
    size_t n;
    double t0, t1;
    double next;                   /* size that the next step may have */
    double *x0, *x1;
    double *stage[ALL_STAGES];     /* slopes; that at t0 is the first, that at t1 the one after the twelfth */
    double *dense[DENSE_TERMS];
    double *trial;
    const double *absolute;        /* tolerance of each state */
    double relative;
    int has_dense;
    int stiff;                     /* steps in a row that stability has held small, not accuracy */
} Explicit;

enum { EXPLICIT_ARRAYS = 2 + ALL_STAGES + DENSE_TERMS + 1 };
static const double RK_SAFETY = 0.9, RK_LEAST = 0.333, RK_MOST = 6.0, RK_STABLE = 6.1;

/* Give it memory: EXPLICIT_ARRAYS * n doubles. */
static void explicit_place(Explicit *e, size_t n, double *memory) {
    e->n = n;
    e->x0 = memory;
    e->x1 = memory + n;
    for (int k = 0; k < ALL_STAGES; k++) e->stage[k] = memory + (size_t)(2 + k) * n;
    for (int k = 0; k < DENSE_TERMS; k++) e->dense[k] = memory + (size_t)(2 + ALL_STAGES + k) * n;
    e->trial = memory + (size_t)(2 + ALL_STAGES + DENSE_TERMS) * n;
}

static double rk_scale(const Explicit *e, size_t i, const double *x) {
    return e->absolute[i] + e->relative * fabs(x[i]);
}

/* Begin at t, where x1 is set: slope and a size for the first step, at most `most` (II.4 of the book). */
static int explicit_begin(Explicit *e, Derivatives *f, void *context, double t, double most) {
    double d0 = 0.0, d1 = 0.0, d2 = 0.0, h;
    const double n = (double)(e->n > 0 ? e->n : 1);
    int status;
    e->t0 = e->t1 = t;
    e->stiff = 0;
    e->has_dense = 0;
    status = f(context, t, e->x1, e->stage[STAGES]);
    if (status != 0) return status;
    for (size_t i = 0; i < e->n; i++) {
        const double scale = rk_scale(e, i, e->x1);
        d0 += e->x1[i] / scale * (e->x1[i] / scale);
        d1 += e->stage[STAGES][i] / scale * (e->stage[STAGES][i] / scale);
    }
    d0 = sqrt(d0 / n);
    d1 = sqrt(d1 / n);
    h = d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1;
    h = fmin(h, most);
    for (size_t i = 0; i < e->n; i++) e->trial[i] = e->x1[i] + h * e->stage[STAGES][i];
    status = f(context, t + h, e->trial, e->stage[1]);
    if (status != 0) {
        e->next = 0.01 * h; /* the first steps find their size */
        return 0;
    }
    for (size_t i = 0; i < e->n; i++) {
        const double change = (e->stage[1][i] - e->stage[STAGES][i]) / rk_scale(e, i, e->x1);
        d2 += change * change;
    }
    d2 = sqrt(d2 / n) / h;
    e->next = fmax(d1, d2) <= 1e-15 ? fmax(1e-6, 1e-3 * h) : pow(0.01 / fmax(d1, d2), 0.125);
    e->next = fmin(fmin(100.0 * h, e->next), most);
    return 0;
}

/* Try one step from t1 over h. Return the error over what is allowed: up to 1 is good; or -1 and the status of f. */
static double explicit_try(Explicit *e, Derivatives *f, void *context, double h, int *status) {
    double fifth = 0.0, third = 0.0, slopes = 0.0, states = 0.0, limit;
    double *swap;
    const double t = e->t1;
    swap = e->stage[0], e->stage[0] = e->stage[STAGES], e->stage[STAGES] = swap;
    swap = e->x0, e->x0 = e->x1, e->x1 = swap;
    for (int s = 1; s <= STAGES; s++) {
        double *x = s == STAGES ? e->x1 : e->trial;
        for (size_t i = 0; i < e->n; i++) {
            double sum = 0.0;
            for (int j = 0; j < s; j++) sum += RK_A[s][j] * e->stage[j][i];
            x[i] = e->x0[i] + h * sum;
        }
        *status = f(context, s == STAGES ? t + h : t + RK_C[s] * h, x, e->stage[s]);
        if (*status != 0) break;
    }
    if (*status == 0) {
        for (size_t i = 0; i < e->n; i++) {
            const double scale = fmax(rk_scale(e, i, e->x0), rk_scale(e, i, e->x1));
            double e5 = 0.0, e3 = 0.0;
            for (int j = 0; j < STAGES; j++) {
                e5 += RK_E5[j] * e->stage[j][i];
                e3 += RK_E3[j] * e->stage[j][i];
            }
            fifth += e5 / scale * (e5 / scale);
            third += e3 / scale * (e3 / scale);
            slopes += (e->stage[STAGES][i] - e->stage[STAGES - 1][i]) * (e->stage[STAGES][i] - e->stage[STAGES - 1][i]);
            states += (e->x1[i] - e->trial[i]) * (e->x1[i] - e->trial[i]);
        }
        limit = fifth + 0.01 * third;
        limit = limit > 0.0 ? fabs(h) * fifth / sqrt(limit * (double)(e->n > 0 ? e->n : 1)) : 0.0;
        if (limit <= 1.0) {
            e->t0 = t;
            e->t1 = t + h;
            e->has_dense = 0;
            if (states > 0.0 && fabs(h) * sqrt(slopes / states) > RK_STABLE) e->stiff++;
            else e->stiff = 0;
            return limit;
        }
    }
    swap = e->stage[0], e->stage[0] = e->stage[STAGES], e->stage[STAGES] = swap; /* as if it had not been tried */
    swap = e->x0, e->x0 = e->x1, e->x1 = swap;
    return *status == 0 && isfinite(limit) ? limit : *status == 0 ? INFINITY : -1.0;
}

/* What the error of a step says of the size of the next. */
static double explicit_factor(double error) {
    const double factor = error > 0.0 ? RK_SAFETY * pow(error, -0.125) : RK_MOST;
    return isfinite(error) ? fmin(RK_MOST, fmax(RK_LEAST, factor)) : RK_LEAST;
}

/* The states at t within the last step. Three more evaluations, once a step. */
static int explicit_at(Explicit *e, Derivatives *f, void *context, double t, double *x) {
    const double h = e->t1 - e->t0;
    const double theta = (t - e->t0) / h;
    if (t == e->t1) {
        memcpy(x, e->x1, e->n * sizeof *x);
        return 0;
    }
    if (!e->has_dense) {
        for (int s = STAGES + 1; s < ALL_STAGES; s++) {
            int status;
            for (size_t i = 0; i < e->n; i++) {
                double sum = 0.0;
                for (int j = 0; j < s; j++) sum += RK_A[s][j] * e->stage[j][i];
                e->trial[i] = e->x0[i] + h * sum;
            }
            status = f(context, e->t0 + RK_C[s] * h, e->trial, e->stage[s]);
            if (status != 0) return status;
        }
        for (size_t i = 0; i < e->n; i++) {
            const double step = e->x1[i] - e->x0[i];
            e->dense[0][i] = step;
            e->dense[1][i] = h * e->stage[0][i] - step;
            e->dense[2][i] = 2.0 * step - h * (e->stage[STAGES][i] + e->stage[0][i]);
            for (int k = 0; k < DENSE_TERMS - 3; k++) {
                double sum = 0.0;
                for (int j = 0; j < ALL_STAGES; j++) sum += RK_D[k][j] * e->stage[j][i];
                e->dense[3 + k][i] = h * sum;
            }
        }
        e->has_dense = 1;
    }
    for (size_t i = 0; i < e->n; i++) {
        double sum = 0.0;
        for (int k = DENSE_TERMS - 1; k >= 0; k--) sum = (sum + e->dense[k][i]) * (k % 2 == 0 ? theta : 1.0 - theta);
        x[i] = e->x0[i] + sum;
    }
    return 0;
}

#endif
