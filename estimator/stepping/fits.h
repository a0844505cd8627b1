/* fits: whole least-squares fits of a job, from start to optimum. Part of stepper.c: knows candidates and costs.
 *
 * A fit by trust_region.h asks for residuals some ten times, and for derivatives nearly as often. Where a simulation
 * takes microseconds, messages and arrays around each of these cost far more than it does. Derivatives are one-sided
 * differences. A simulation that fails ends all fits: whoever asked does them by single candidates then.
 */

typedef struct {
    int64_t starts, parameters, evaluations;
    double ftol, xtol;
    double least_step;         /* of differences: of a logarithm, or times a parameter's size */
    double known_cost;
    const double *known;       /* [parameters], on their scales: an optimum that is known; NULL: none */
    const double *start;       /* [starts][parameters], on their scales, inside the bounds */
    const double *low, *high;  /* [parameters]: bounds, on their scales */
    const double *lower, *upper; /* [parameters]: the same in their units */
    const int64_t *log;        /* [parameters]: whether their scale is logarithmic */
    const int64_t *column;     /* [experiments][values of the job]: the parameter that sets it; -1: none */
    const double *gain;        /* [experiments][values of the job] */
    const double *shift;       /* [experiments][values of the job]: added to gain times parameter; alone where none */
    const double *weights;     /* [outputs]: 1 / deviation */
    double *ends;              /* [starts][parameters]: where each fit has ended, on their scales */
    double *costs;             /* [starts]: sums of weighted squares there */
    int64_t *ended;            /* [starts]: ENDED or ENDED_AT_KNOWN */
    int64_t simulations, steps; /* that were done */
} Fits;

/* What the fits of one call work with: x first, then a candidate beside it for each parameter. */
typedef struct {
    Fmu *fmu;
    const Job *job;
    const FloatingPoint *saved;
    Fits *fits;
    int64_t *claim;
    Batch batch;
    double *values;      /* of the batch */
    int64_t rows, count; /* of all experiments; residuals */
    double *matrix;      /* [parameters + 1][count]: derivatives, then residuals */
    double *forward;     /* [parameters]: steps of the differences */
} Fitting;

/* Write a candidate's values: x, with one parameter moved by a step; `which` -1: none. */
static void place(const Fitting *f, const double *x, int64_t which, double step, int64_t index) {
    const Fits *fits = f->fits;
    const int64_t stride = f->job->parameters + f->job->sensor_values, all = f->job->experiments * stride;
    double *values = f->values + index * all;
    for (int64_t v = 0; v < all; v++) {
        const int64_t k = fits->column[v];
        double value = 0.0;
        if (k >= 0) {
            const double own = k == which ? x[k] + step : x[k];
            value = fits->log[k] ? exp(own) : own;
            if (which < 0) value = fmin(fmax(value, fits->lower[k]), fits->upper[k]);
            value *= fits->gain[v];
        }
        values[v] = value + fits->shift[v];
    }
}

static int simulate_placed(Fitting *f, int64_t index) {
    f->batch.steps[index] = 0;
    *f->claim = f->fits->simulations++;
    const int64_t outcome = sound_candidate(f->fmu, f->job, &f->batch, index, f->saved);
    f->fits->steps += f->batch.steps[index];
    return outcome == FINISHED;
}

/* Write a column of the matrix: weighted residuals of x, or their derivative by parameter `which`. */
static void fill(const Fitting *f, int64_t which) {
    const int64_t p = f->fits->parameters, outputs = f->job->outputs, size = f->rows * outputs;
    const double *here = f->batch.shown, *there = here + (which + 1) * size;
    double *column = f->matrix + (which < 0 ? p : which) * f->count;
    for (int64_t e = 0; e < f->job->experiments; e++) {
        const Experiment *experiment = &f->job->experiment[e];
        const double *measured = experiment->measured;
        for (int64_t k = 0; k < experiment->samples; k++)
            for (int64_t j = 0; j < outputs; j++, here++, there++, measured++) {
                if (isnan(*measured)) continue;
                *column++ = which < 0 ? (*here - *measured) * f->fits->weights[j]
                                      : (*there - *here) * f->fits->weights[j] / f->forward[which];
            }
    }
}

static double long_dot(const double *a, const double *b, int64_t n) {
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    int64_t k = 0;
    for (; k + 4 <= n; k += 4)
        for (int64_t i = 0; i < 4; i++) sums[i] += a[k + i] * b[k + i];
    for (; k < n; k++) sums[0] += a[k] * b[k];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* The triangular factor of the matrix by Householder's reflections; the matrix is lost. Returns its rows. */
static int64_t triangular(Fitting *f, double *triangle) {
    const int64_t k = f->fits->parameters + 1, n = f->count, rows = n < k ? n : k;
    memset(triangle, 0, (size_t)(k * k) * sizeof(double));
    for (int64_t j = 0; j < rows; j++) {
        double *own = f->matrix + j * n + j;
        const double length = sqrt(long_dot(own, own, n - j)), end = own[0] > 0 ? -length : length;
        triangle[j * k + j] = end;
        if (length == 0) {
            for (int64_t l = j + 1; l < k; l++) triangle[j * k + l] = f->matrix[l * n + j];
            continue;
        }
        own[0] -= end;
        const double square = -end * own[0]; /* half of the reflected vector's */
        for (int64_t l = j + 1; l < k; l++) {
            double *other = f->matrix + l * n + j;
            const double part = long_dot(own, other, n - j) / square;
            for (int64_t i = 0; i < n - j; i++) other[i] -= part * own[i];
            triangle[j * k + l] = other[0];
        }
    }
    return rows;
}

/* Do one fit; 0: a simulation has failed. */
static int one_fit(Fitting *f, int64_t s, TrustRegion *fit, double *memory, double *triangle) {
    Fits *fits = f->fits;
    const int64_t p = fits->parameters;
    *fit = (TrustRegion){.p = p, .evaluations = fits->evaluations, .ftol = fits->ftol, .xtol = fits->xtol,
                         .low = fits->low, .high = fits->high, .known = fits->known, .known_cost = fits->known_cost};
    int64_t asked = trust_region_begin(fit, fits->start + s * p, memory);
    while (asked == ASKS_RESIDUALS || asked == ASKS_SLOPES) {
        if (asked == ASKS_RESIDUALS) {
            place(f, fit->tried, -1, 0.0, 0);
            if (!simulate_placed(f, 0)) return 0;
            fill(f, -1);
            const double *r = f->matrix + p * f->count;
            asked = take_cost(fit, long_dot(r, r, f->count), f->count);
            continue;
        }
        for (int64_t k = 0; k < p; k++) { /* ahead, or back where a bound is near */
            const double size = fits->log[k] ? 1.0 : fmax(fabs(fit->x[k]), 1e-3 * (fits->high[k] - fits->low[k]));
            const double step = fits->least_step * size;
            f->forward[k] = fit->x[k] + step <= fits->high[k] ? step : -step;
            place(f, fit->x, k, f->forward[k], k + 1);
            if (!simulate_placed(f, k + 1)) return 0;
            fill(f, k);
        }
        fill(f, -1); /* the last triangle has taken it */
        asked = take_slopes(fit, triangle, triangular(f, triangle));
    }
    memcpy(fits->ends + s * p, fit->x, (size_t)p * sizeof(double));
    fits->costs[s] = fit->cost;
    fits->ended[s] = asked;
    return 1;
}

/* Do all fits. Returns 1; 0: a simulation has failed, or there is no memory. */
EXPORT int64_t stepper_fit(Fmu *fmu, const Job *job, int64_t *claim, Fits *fits) {
    const int64_t p = fits->parameters, n = p + 1, stride = job->parameters + job->sensor_values;
    Fitting f = {.fmu = fmu, .job = job, .fits = fits, .claim = claim};
    FloatingPoint saved;
    TrustRegion fit;
    int64_t sound = 0;
    if (job->outputs > MAX_OUTPUTS || job->inputs > MAX_INPUTS) return 0;
    for (int64_t e = 0; e < job->experiments; e++) {
        const int64_t samples = job->experiment[e].samples;
        f.rows += samples;
        for (int64_t k = 0; k < samples * job->outputs; k++) f.count += !isnan(job->experiment[e].measured[k]);
    }
    const int64_t numbers[] = {n * job->experiments * stride, n,     n, n, n, n * f.rows * job->outputs, n * f.count, n,
                               n * n, trust_region_numbers(p)};
    int64_t all = 0;
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++) all += numbers[k];
    double *memory = malloc((size_t)all * sizeof(double)), *at = memory;
    if (memory == NULL) return 0;
    f.batch = (Batch){.claim = claim, .candidates = n, .quota = n, .refine = 1};
    f.batch.values = f.values = at, at += numbers[0];
    f.batch.bounds = at;
    for (int64_t k = 0; k < n; k++) *at++ = INFINITY;
    f.batch.costs = at, at += n;
    f.batch.steps = (int64_t *)(void *)at, at += n;
    f.batch.outcomes = (int64_t *)(void *)at, at += n;
    f.batch.shown = at, at += numbers[5];
    f.matrix = at, at += numbers[6];
    f.forward = at, at += n;
    double *triangle = at;
    at += n * n;
    remember(&saved);
    f.saved = &saved;
    sound = 1;
    for (int64_t s = 0; s < fits->starts && sound; s++) sound = one_fit(&f, s, &fit, at, triangle);
    *claim = -1;
    free(memory);
    return sound;
}
