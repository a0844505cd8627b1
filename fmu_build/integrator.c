/* One integrator for every model: an exponential Rosenbrock step. Knows the model's derivatives, nothing of FMI.
 *
 * Linear models, x' = A x + b with b from the inputs held over the step h, are stepped exactly:
 *
 *     x += growth x + gain b        growth = exp(hA) - I,   gain = h phi1(hA)
 *
 * whatever h and however stiff. growth and gain are computed once for a set of parameters and a step. b is what
 * `derivatives` gives at x = 0, the columns of A what it gives at unit vectors.
 *
 * Other models, x' = f(x), are stepped by exprb43 (Hochbruck, Ostermann and Schweitzer, SIAM J. Numer. Anal. 47, 2009):
 * order 4, an embedded order 3, exact where f is linear, stable where it is stiff. With J = df/dx at x, by
 * central differences, F = f(x) and g(y) = f(y) - f(x) - J (y - x):
 *
 *     y2   = x + h/2 phi1(hJ/2) F
 *     y3   = x + h phi1(hJ) (F + g(y2))
 *     x   += h phi1(hJ) F + h phi3(hJ) (16 g(y2) - 2 g(y3)) + e
 *     e    = h phi4(hJ) (12 g(y3) - 48 g(y2))          the difference of the two orders, taken as the error
 *
 * Substeps are as long as TOLERANCE allows; the last one's length is part of the state, so that a restored state
 * repeats itself to the bit.
 *
 * phi_k(z) = sum z^n / (n + k)!, phi_0 = exp. z is halved until its norm is below 1/2, the highest phi is summed by
 * Horner's rule, the lower ones follow from phi_k = z phi_{k+1} + I/k!, and all are doubled back. exp(z) - I is carried
 * instead of exp(z), doubled as D <- D D + 2 D, so that slow motions beside fast ones are not rounded away.
 */
#include "model.h"

#define TOLERANCE 1e-10      /* of max(|x|, nominal): error of a substep, models that are not linear */
#define MAX_SUBSTEPS 1000000 /* in one communication step, or from one change of mode to the next */

typedef struct {
    double at[N_STATES][N_STATES];
} Matrix;

static inline double larger_of(double a, double b)
{
    return a > b ? a : b;
}

/* c = a b */
static inline void matrix_multiply(const Matrix *restrict a, const Matrix *restrict b, Matrix *restrict c)
{
    for (int i = 0; i < N_STATES; i++) {
        double row[N_STATES];
        for (int j = 0; j < N_STATES; j++) row[j] = a->at[i][0] * b->at[0][j];
        for (int k = 1; k < N_STATES; k++)
            for (int j = 0; j < N_STATES; j++) row[j] += a->at[i][k] * b->at[k][j];
        for (int j = 0; j < N_STATES; j++) c->at[i][j] = row[j];
    }
}

/* y = a x */
static inline void matrix_apply(const Matrix *restrict a, const double *restrict x, double *restrict y)
{
    for (int i = 0; i < N_STATES; i++) {
        y[i] = a->at[i][0] * x[0];
        for (int j = 1; j < N_STATES; j++) y[i] += a->at[i][j] * x[j];
    }
}

/* Largest row sum of absolute values; NaN or infinite where an entry is. */
static inline double matrix_norm(const Matrix *a)
{
    double norm = 0;
    for (int i = 0; i < N_STATES; i++) {
        double sum = 0;
        for (int j = 0; j < N_STATES; j++) sum += fabs(a->at[i][j]);
        if (!(sum <= norm)) norm = sum;
        if (isnan(sum)) return sum;
    }
    return norm;
}

/* phi[0] is exp(z) - I, phi[k] is phi_k(z) for k = 1 ... levels. */
typedef struct {
    Matrix phi[5];
} Exponential;

/* From z to 2 z. */
static inline void exponential_double(Exponential *e, int levels)
{
    Matrix p00, p01, p11, p12, p22;
    Matrix *phi = e->phi;
    matrix_multiply(&phi[0], &phi[0], &p00);
    matrix_multiply(&phi[0], &phi[1], &p01);
    if (levels == 4) {
        matrix_multiply(&phi[1], &phi[1], &p11);
        matrix_multiply(&phi[1], &phi[2], &p12);
        matrix_multiply(&phi[2], &phi[2], &p22);
    }
    for (int i = 0; i < N_STATES; i++)
        for (int j = 0; j < N_STATES; j++) {
            if (levels == 4) { /* phi_2k(2z) = (phi_k phi_k + 2 sum phi_n / (2k - n)!) / 4^k, the odd ones alike */
                phi[4].at[i][j] = (p22.at[i][j] + 2 * (phi[3].at[i][j] + phi[4].at[i][j])) / 16;
                phi[3].at[i][j] = (p12.at[i][j] + 2 * phi[3].at[i][j] + phi[2].at[i][j]) / 8;
                phi[2].at[i][j] = (p11.at[i][j] + 2 * phi[2].at[i][j]) / 4;
            }
            phi[1].at[i][j] += p01.at[i][j] / 2;
            phi[0].at[i][j] = p00.at[i][j] + 2 * phi[0].at[i][j];
        }
}

/* e for scale times a; false if a is not finite. */
static inline bool exponential(const Matrix *a, double scale, int levels, Exponential *e)
{
    static const double factorial[] = {1, 1, 2, 6, 24};
    double norm = matrix_norm(a) * scale;
    int doublings = 0;
    int terms;
    Matrix z, product;
    if (!(norm <= 1e300)) return false;
    for (; norm > 0.5; norm *= 0.5, doublings++) scale *= 0.5;
    for (int i = 0; i < N_STATES; i++)
        for (int j = 0; j < N_STATES; j++) z.at[i][j] = scale * a->at[i][j];
    terms = norm > 1.0 / 16 ? 14 : 9; /* the first one left out is below 2^-53 of the first */
    for (int i = 0; i < N_STATES; i++)
        for (int j = 0; j < N_STATES; j++) e->phi[levels].at[i][j] = i == j;
    for (int n = levels + terms - 1; n > levels; n--) {
        const double reciprocal = 1.0 / n;
        matrix_multiply(&z, &e->phi[levels], &product);
        for (int i = 0; i < N_STATES; i++)
            for (int j = 0; j < N_STATES; j++) e->phi[levels].at[i][j] = (i == j) + product.at[i][j] * reciprocal;
    }
    for (int i = 0; i < N_STATES; i++)
        for (int j = 0; j < N_STATES; j++) e->phi[levels].at[i][j] /= factorial[levels];
    for (int k = levels - 1; k >= 0; k--) {
        matrix_multiply(&z, &e->phi[k + 1], &e->phi[k]);
        for (int i = 0; i < N_STATES && k > 0; i++) e->phi[k].at[i][i] += 1 / factorial[k];
    }
    while (doublings-- > 0) exponential_double(e, levels);
    return true;
}

/* ---- Linear models ---- */

/* Where the motion has died away within the step, an entry of gain may be a small remainder of what it was on the way:
   the settled current beside the starting current, and doubling has rounded the latter. There, A gain = growth is
   solved by elimination, corrected twice (Skeel 1980: the second time, every entry has its own small relative error).
   States on which nothing depends, such as an angle, are left as they are. */
static void gain_refine(const Matrix *a, const Matrix *growth, Matrix *gain)
{
    int core[N_STATES], order[N_STATES];
    int n = 0;
    Matrix lu;
    for (int j = 0; j < N_STATES; j++) {
        double sum = 0;
        for (int i = 0; i < N_STATES; i++) sum += fabs(a->at[i][j]);
        if (sum > 0) core[n++] = j;
    }
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double there = growth->at[core[i]][core[j]] + (i == j);
            const double back = growth->at[core[j]][core[i]] + (i == j);
            if (!(fabs(there * back) < 0.01)) return; /* not died away */
            lu.at[i][j] = a->at[core[i]][core[j]];
        }
    for (int i = 0; i < n; i++) order[i] = i;
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(lu.at[order[i]][k]) > fabs(lu.at[order[best]][k])) best = i;
        const int pivot = order[best];
        order[best] = order[k];
        order[k] = pivot;
        if (lu.at[pivot][k] == 0) return;
        for (int i = k + 1; i < n; i++) {
            lu.at[order[i]][k] /= lu.at[pivot][k];
            for (int j = k + 1; j < n; j++) lu.at[order[i]][j] -= lu.at[order[i]][k] * lu.at[pivot][j];
        }
    }
    for (int column = 0; column < 2 * n; column++) { /* each twice */
        double x[N_STATES];
        const int c = core[column % n];
        for (int i = 0; i < n; i++) {
            const int row = core[order[i]];
            x[i] = growth->at[row][c];
            for (int j = 0; j < n; j++) x[i] -= a->at[row][core[j]] * gain->at[core[j]][c];
            for (int j = 0; j < i; j++) x[i] -= lu.at[order[i]][j] * x[j];
        }
        for (int i = n - 1; i >= 0; i--) {
            for (int j = i + 1; j < n; j++) x[i] -= lu.at[order[i]][j] * x[j];
            x[i] /= lu.at[order[i]][i];
        }
        for (int i = 0; i < n; i++) gain->at[core[i]][c] += x[i];
    }
}

/* growth and gain of a step; false if they are not finite. */
static bool propagation(const Matrix *a, double step, Matrix *growth, Matrix *gain)
{
    Exponential e;
    if (!exponential(a, step, 1, &e)) return false;
    *growth = e.phi[0];
    for (int i = 0; i < N_STATES; i++)
        for (int j = 0; j < N_STATES; j++) gain->at[i][j] = step * e.phi[1].at[i][j];
    gain_refine(a, growth, gain);
    return true;
}

/* A of x' = A x + b. What does not matter, the inputs, is kept out of the differences. */
static void linear_matrix(const Values *values, Matrix *a)
{
    Values probe = *values;
    Rates origin, rates;
    for (int k = 0; k < N_VARIABLES; k++)
        if (model_table[k].kind == MODEL_input || model_table[k].kind == MODEL_state) probe.flat[k] = 0;
    derivatives(&probe.named, &origin.named);
    for (int j = 0; j < N_STATES; j++) {
        probe.flat[model_state_places[j]] = 1;
        derivatives(&probe.named, &rates.named);
        probe.flat[model_state_places[j]] = 0;
        for (int i = 0; i < N_STATES; i++) a->at[i][j] = rates.flat[i] - origin.flat[i];
    }
}

/* ---- Other models ---- */

/* J = df/dx at values, by central differences. */
static void jacobian_by_differences(const Values *values, Matrix *jacobian)
{
    Values probe = *values;
    Rates there, here;
    for (int j = 0; j < N_STATES; j++) {
        const int place = model_state_places[j];
        const double x = values->flat[place];
        const double shift = 6e-6 * larger_of(fabs(x), model_table[place].nominal); /* cube root of the rounding error */
        const double above = x + shift;
        const double below = x - shift;
        probe.flat[place] = above;
        derivatives(&probe.named, &there.named);
        probe.flat[place] = below;
        derivatives(&probe.named, &here.named);
        for (int i = 0; i < N_STATES; i++) jacobian->at[i][j] = (there.flat[i] - here.flat[i]) / (above - below);
        probe.flat[place] = x;
    }
}

/* One exprb43 step of length h from the state in values. Returns the error in units of the tolerance, infinite where
   something is not finite, and the new state in x_new. */
static double rosenbrock_step(const Values *values, double h, double *x_new)
{
    Values probe = *values;
    Rates rates;
    Matrix jacobian;
    Exponential e;
    double x[N_STATES], rate[N_STATES];       /* x, F */
    double change[N_STATES], bent[N_STATES];  /* y - x, J (y - x) */
    double g2[N_STATES], g3[N_STATES];
    double third[N_STATES], fourth[N_STATES]; /* phi3 and phi4 terms */
    double worst = 0;
    derivatives(&probe.named, &rates.named);
    for (int i = 0; i < N_STATES; i++) {
        x[i] = values->flat[model_state_places[i]];
        rate[i] = rates.flat[i];
    }
    jacobian_by_differences(values, &jacobian);

    if (!exponential(&jacobian, h / 2, 4, &e)) return INFINITY;
    matrix_apply(&e.phi[1], rate, change);
    for (int i = 0; i < N_STATES; i++) {
        change[i] *= h / 2;
        probe.flat[model_state_places[i]] = x[i] + change[i];
    }
    derivatives(&probe.named, &rates.named);
    matrix_apply(&jacobian, change, bent);
    for (int i = 0; i < N_STATES; i++) g2[i] = rates.flat[i] - rate[i] - bent[i];

    exponential_double(&e, 4);
    for (int i = 0; i < N_STATES; i++) third[i] = rate[i] + g2[i];
    matrix_apply(&e.phi[1], third, change);
    for (int i = 0; i < N_STATES; i++) {
        change[i] *= h;
        probe.flat[model_state_places[i]] = x[i] + change[i];
    }
    derivatives(&probe.named, &rates.named);
    matrix_apply(&jacobian, change, bent);
    for (int i = 0; i < N_STATES; i++) g3[i] = rates.flat[i] - rate[i] - bent[i];

    matrix_apply(&e.phi[1], rate, change);
    for (int i = 0; i < N_STATES; i++) bent[i] = 16 * g2[i] - 2 * g3[i];
    matrix_apply(&e.phi[3], bent, third);
    for (int i = 0; i < N_STATES; i++) bent[i] = 12 * g3[i] - 48 * g2[i];
    matrix_apply(&e.phi[4], bent, fourth);
    for (int i = 0; i < N_STATES; i++) {
        const double scale = larger_of(fabs(x[i]), model_table[model_state_places[i]].nominal);
        const double error = fabs(h * fourth[i]) / (TOLERANCE * scale);
        x_new[i] = x[i] + h * (change[i] + third[i] + fourth[i]);
        if (!isfinite(x_new[i] - error)) return INFINITY;
        if (error > worst) worst = error;
    }
    return worst;
}

/* One communication step, in substeps of about *substep (0: not known yet), which is adapted. False, and none made,
   where the state would become infinite or NaN, or cannot be followed within the tolerance. */
static bool rosenbrock_integrate(Values *values, double step, double *substep)
{
    Values moving = *values;
    double remaining = step;
    for (int count = 0; count < MAX_SUBSTEPS; count++) {
        double x_new[N_STATES];
        double h = *substep > 0 && *substep < remaining ? *substep : remaining;
        double error, factor;
        if (h < remaining && h > remaining / 2) h = remaining / 2; /* two equal ones, not a long and a short */
        error = rosenbrock_step(&moving, h, x_new);
        factor = error > 0 ? 0.9 / sqrt(sqrt(error)) : 5; /* the error grows as h^4 */
        if (!(factor > 0.2)) factor = 0.2;
        if (factor > 5) factor = 5;
        *substep = factor * h;
        if (error <= 1) {
            for (int i = 0; i < N_STATES; i++) moving.flat[model_state_places[i]] = x_new[i];
            if (h == remaining) {
                *values = moving;
                return true;
            }
            remaining -= h;
        } else if (h < 1e-12 * step) {
            return false;
        }
    }
    return false;
}
