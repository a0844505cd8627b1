/* Directional derivatives of derivatives, outputs and margins, the modes kept. Knows the model's equations, nothing of an FMI version.
 *
 * With respect to the states of a linear model, derivatives of states are exact: f(seed) - f(0). All else is the limit
 * of central differences along the seed, (f(x + t s) - f(x - t s)) / 2 t, for t halved again and again, extrapolated to
 * t = 0 (Ridders, Adv. Eng. Software 4, 1982): what changed least from one extrapolation to the next is taken, rounding
 * counted. For smooth equations about 1e-12 of the largest term is left of rounding and truncation.
 */
#define RIDDERS_ROWS 16
#define RIDDERS_REACH 0.5 /* of max(|x|, nominal): the first, longest way along the seed */

enum { N_RATES = N_STATES + N_OUTPUTS + N_MODES };

/* Rates, outputs and margins at values + way seed, no variable moved out of min and max by more than the way; false if not finite. */
static bool sensitivity_rates(const Values *values, const double *seed, double way, double *rates)
{
    Values probe = *values;
    Rates there;
    Margins margins;
    double sum = 0;
    for (int k = 0; k < N_VARIABLES; k++) probe.flat[k] += way * seed[k];
    derivatives(&probe.named, &there.named);
    model_switches(&probe, &margins);
    memcpy(rates, there.flat, sizeof there.flat);
    for (int k = 0; k < N_MODES; k++) rates[N_STATES + N_OUTPUTS + k] = margins.flat[k].margin;
    for (int k = 0; k < N_RATES; k++) sum += fabs(rates[k]);
    return isfinite(sum);
}

/* Along seed, by place in the table, at values. False where the equations are not finite around there. */
static bool sensitivity_by_differences(const Values *values, const double *seed, double *along)
{
    double tableau[2][RIDDERS_ROWS][N_RATES];
    double error[N_RATES], rounding[N_RATES];
    double way = INFINITY;
    int rows = 0;
    for (int k = 0; k < N_RATES; k++) {
        along[k] = 0;
        error[k] = INFINITY;
    }
    for (int k = 0; k < N_VARIABLES; k++) {
        const double scale = larger_of(fabs(values->flat[k]), model_table[k].nominal);
        double reach = RIDDERS_REACH * scale / fabs(seed[k]);
        if (seed[k] == 0) continue;
        if (model_table[k].kind == MODEL_parameter && values->flat[k] != 0) /* a parameter keeps its sign */
            reach = 0.5 * RIDDERS_REACH * fabs(values->flat[k] / seed[k]);
        if (reach < way) way = reach;
    }
    if (!isfinite(way)) return true; /* no seed: no change */
    for (int attempt = 0; rows < RIDDERS_ROWS && attempt < 40; attempt++, way *= 0.5) {
        double above[N_RATES], below[N_RATES];
        double(*now)[N_RATES] = tableau[rows % 2];
        double(*last)[N_RATES] = tableau[(rows + 1) % 2];
        double factor = 4;
        if (!sensitivity_rates(values, seed, way, above) || !sensitivity_rates(values, seed, -way, below)) {
            if (rows > 0) break;
            continue;
        }
        for (int k = 0; k < N_RATES; k++) {
            now[0][k] = (above[k] / 2 - below[k] / 2) / way;
            rounding[k] = DBL_EPSILON * larger_of(fabs(above[k]), fabs(below[k])) / way;
        }
        for (int m = 1; m <= rows; m++, factor *= 4)
            for (int k = 0; k < N_RATES; k++) {
                const double was = now[m - 1][k];
                double changed;
                now[m][k] = was + (was - last[m - 1][k]) / (factor - 1);
                changed = rounding[k] + larger_of(fabs(now[m][k] - was), fabs(now[m][k] - last[m - 1][k]));
                if (changed <= error[k]) {
                    error[k] = changed;
                    along[k] = now[m][k];
                }
            }
        rows++;
    }
    return rows > 1;
}

/* sensitivity[u] = sum over k of d unknown[u] / d known[k] seed[k]. Known: inputs, parameters, states. Unknown: states,
   calculated outputs, derivatives, margins. */
static Status instance_differentiate(Instance *instance, const unsigned int *unknown, size_t unknowns,
                                     const unsigned int *known, size_t knowns, const double *seed, double *sensitivity)
{
    double direction[N_VARIABLES] = {0}, other[N_VARIABLES];
    double along[N_RATES], exact[N_STATES] = {0};
    double curved[N_RATES];
    const int64_t phase = instance->state.phase;
    bool changed;
    if (phase < PHASE_INITIALIZATION || phase > PHASE_TERMINATED)
        return instance_refuse(instance, "a directional derivative");
    if (phase <= PHASE_STEPPING && instance_settle(instance, &changed) != INSTANCE_OK) return INSTANCE_ERROR;
    if (!is_given(unknown, unknowns) || !is_given(known, knowns) || !is_given(seed, knowns) ||
        !is_given(sensitivity, unknowns))
        return instance_miss(instance);
    for (size_t k = 0; k < knowns; k++) {
        if (known[k] >= N_VARIABLES || model_table[known[k]].kind >= MODEL_output || !isfinite(seed[k]))
            return instance_report(instance, INSTANCE_ERROR,
                                   "value reference %u, seed %g: no input, parameter or state to derive by", known[k],
                                   seed[k]);
        direction[known[k]] += seed[k];
    }
    for (size_t k = 0; k < unknowns; k++) {
        const bool derivative = unknown[k] >= FIRST_DERIVATIVE && unknown[k] < FIRST_MARGIN + N_MODES;
        const bool value = unknown[k] < N_VARIABLES && (model_table[unknown[k]].kind == MODEL_state ||
                                                        model_table[unknown[k]].kind == MODEL_output);
        if (!derivative && !value)
            return instance_report(instance, INSTANCE_ERROR, "value reference %u: no output or derivative to derive",
                                   unknown[k]);
    }
    memcpy(other, direction, sizeof other);
    if (!sensitivity_by_differences(&instance->state.values, direction, curved))
        return instance_report(instance, INSTANCE_DISCARD, "a derivative is not finite nearby");
    memcpy(along, curved, sizeof along);
    if (MODEL_LINEAR) {
        Values probe = instance->state.values;
        Rates origin, rates;
        for (int k = 0; k < N_VARIABLES; k++)
            if (model_table[k].kind == MODEL_input || model_table[k].kind == MODEL_state) probe.flat[k] = 0;
        derivatives(&probe.named, &origin.named);
        for (int k = 0; k < N_STATES; k++) {
            const int place = model_state_places[k];
            probe.flat[place] = direction[place];
            other[place] = 0;
        }
        derivatives(&probe.named, &rates.named);
        for (int k = 0; k < N_STATES; k++) exact[k] = rates.flat[k] - origin.flat[k];
        if (!sensitivity_by_differences(&instance->state.values, other, along))
            return instance_report(instance, INSTANCE_DISCARD, "a derivative is not finite nearby");
    }
    for (size_t k = 0; k < unknowns; k++) {
        if (N_MODES > 0 && unknown[k] >= FIRST_MARGIN) {
            sensitivity[k] = curved[N_STATES + N_OUTPUTS + unknown[k] - FIRST_MARGIN];
        } else if (unknown[k] >= FIRST_DERIVATIVE) {
            const unsigned int state = unknown[k] - FIRST_DERIVATIVE;
            sensitivity[k] = exact[state] + along[state];
        } else if (model_table[unknown[k]].kind == MODEL_state) {
            sensitivity[k] = direction[unknown[k]];
        } else {
            int place = 0;
            while (model_output_places[place] != (int)unknown[k]) place++;
            sensitivity[k] = curved[N_STATES + place];
        }
    }
    return INSTANCE_OK;
}
