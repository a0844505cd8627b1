/* Random sequences of FMI calls, right and wrong, on one FMU compiled in: for the sanitizers, and for what must hold.
 *
 *     cc -DFMI=2 -DUNIT='"dc_motor_fmu.c"' -I sources -I headers fuzz_calls.c -lm
 *     fuzz_calls SEED SEQUENCES              random calls
 *     fuzz_calls SEED SEQUENCES instances    as many instances created, stepped and freed
 *
 * Several instances of both kinds live at a time. Arguments are right half of the time; else NULL, out of range, NaN,
 * infinite, cut short. Whatever the sequence: no crash (the sanitizers look), a status that FMI knows, no value that is
 * not finite with OK, and after a reset a step is possible. Prints the number of calls, and of those that were OK.
 */
#include UNIT

#include <stdio.h>

#if FMI == 2
#define F(name) fmi2##name
typedef fmi2Component Handle;
typedef fmi2FMUstate Saved;
#else
#define F(name) fmi3##name
typedef fmi3Instance Handle;
typedef fmi3FMUState Saved;
#endif

#define INSTANCES 3
#define SAVED 4
#define CALLS 60 /* in one sequence */
#define WIDTH 8  /* of the arrays */
#define BYTES 4096

static uint64_t seed;
static unsigned long calls, successes;

static unsigned int pick(unsigned int n) /* xorshift64* */
{
    seed ^= seed >> 12, seed ^= seed << 25, seed ^= seed >> 27;
    return (unsigned int)((seed * 2685821657736338717u) >> 33) % n;
}

static double any_double(void)
{
    static const double odd[] = {0, -0.0, -1, 1e-300, -1e300, 1e300, 1e10, NAN, INFINITY, -INFINITY, 5e-324};
    if (pick(2) == 0) return odd[pick(sizeof odd / sizeof *odd)];
    return (pick(2001) - 1000.0) / (1 + pick(1000));
}

static double any_step(void)
{
    return pick(4) > 0 ? 1e-6 * (1 + pick(10000)) : any_double();
}

static void *rarely_null(void *pointer)
{
    return pick(12) == 0 ? NULL : pointer;
}

static void fail(const char *what)
{
    fprintf(stderr, "%s\n", what);
    abort();
}

static int note(int status)
{
    if (status != 0 && status != 2 && status != 3) fail("a status that is neither OK, Discard nor Error");
    calls++;
    successes += status == 0;
    return status;
}

static void finite(int status, const double *values, size_t count)
{
    for (size_t k = 0; note(status) == 0 && values != NULL && k < count; k++) {
        calls -= k > 0, successes -= k > 0;
        if (!isfinite(values[k])) fail("a value that is not finite, with OK");
    }
}

#if FMI == 2
static void quiet(void *environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String text, ...)
{
    (void)environment, (void)name, (void)status;
    if (strlen(category) == 0 || strlen(text) == 0) fail("an empty message");
}

static Handle make(bool exchange, const char *token)
{
    static const fmi2CallbackFunctions functions = {quiet, calloc, free, NULL, NULL};
    return fmi2Instantiate(rarely_null("motor"), exchange ? fmi2ModelExchange : fmi2CoSimulation, token, NULL,
                           rarely_null((void *)&functions), 0, pick(2) == 0);
}

static void specific(Handle c, const unsigned int *vr, size_t n, double *values)
{
    fmi2Boolean yes[2];
    fmi2Integer numbers[WIDTH] = {0};
    fmi2EventInfo info;
    double known[WIDTH];
    for (int k = 0; k < WIDTH; k++) known[k] = any_double();
    switch (pick(15)) {
    case 0: note(fmi2SetupExperiment(c, 0, 0, pick(3) ? 0 : any_double(), pick(2) == 0, any_double())); break;
    case 1: note(fmi2EnterInitializationMode(c)); break;
    case 2: note(fmi2NewDiscreteStates(c, rarely_null(&info))); break;
    case 3: finite(fmi2GetReal(c, vr, n, values), values, vr == NULL ? 0 : n); break;
    case 4: note(fmi2SetReal(c, vr, n, values)); break;
    case 5: case 12: case 13: case 14: note(fmi2DoStep(c, any_double(), any_step(), 0)); break;
    case 6: note(fmi2CompletedIntegratorStep(c, 0, rarely_null(&yes[0]), rarely_null(&yes[1]))); break;
    case 7: note(fmi2GetDirectionalDerivative(c, vr, n, rarely_null((void *)vr), n, rarely_null(known), values)); break;
    case 8: note(fmi2GetInteger(c, vr, n, numbers)); break;
    case 9: note(fmi2SetRealInputDerivatives(c, vr, n, numbers, values)); break;
    case 10: note(fmi2GetRealStatus(c, (fmi2StatusKind)pick(6), rarely_null(values))); break;
    default: note(fmi2GetBooleanStatus(c, (fmi2StatusKind)pick(6), rarely_null(yes))); break;
    }
}

static int step(Handle c, double time, double length)
{
    return fmi2DoStep(c, time, length, 1);
}

static int begin(Handle c)
{
    return fmi2SetupExperiment(c, 0, 0, 0, 0, 0) || fmi2EnterInitializationMode(c) || fmi2ExitInitializationMode(c);
}
#else
static void quiet(void *environment, fmi3Status status, fmi3String category, fmi3String text)
{
    (void)environment, (void)status;
    if (strlen(category) == 0 || strlen(text) == 0) fail("an empty message");
}

static Handle make(bool exchange, const char *token)
{
    fmi3LogMessageCallback log = pick(2) == 0 ? quiet : NULL;
    const bool on = pick(2) == 0;
    if (exchange) return fmi3InstantiateModelExchange("motor", token, NULL, 0, on, NULL, log);
    return fmi3InstantiateCoSimulation(rarely_null("motor"), token, NULL, 0, on, 0, pick(2) == 0, NULL, 0, NULL, log,
                                       NULL);
}

static void specific(Handle c, const unsigned int *vr, size_t n, double *values)
{
    bool yes[5];
    double time;
    fmi3Int32 numbers[WIDTH] = {0};
    const size_t m = pick(6) ? n : pick(WIDTH);
    double known[WIDTH];
    for (int k = 0; k < WIDTH; k++) known[k] = any_double();
    switch (pick(17)) {
    case 0: case 1:
        note(fmi3EnterInitializationMode(c, 0, 0, pick(3) ? 0 : any_double(), pick(2) == 0, any_double()));
        break;
    case 2:
        note(fmi3UpdateDiscreteStates(c, rarely_null(&yes[0]), &yes[1], &yes[2], rarely_null(&yes[3]), &yes[4],
                                      rarely_null(&time)));
        break;
    case 3: finite(fmi3GetFloat64(c, vr, n, values, m), values, vr == NULL || m != n ? 0 : n); break;
    case 4: note(fmi3SetFloat64(c, vr, n, values, m)); break;
    case 5: case 14: case 15: case 16:
        note(fmi3DoStep(c, any_double(), any_step(), 0, rarely_null(&yes[0]), &yes[1], rarely_null(&yes[2]),
                        rarely_null(&time)));
        break;
    case 6: note(fmi3CompletedIntegratorStep(c, 0, rarely_null(&yes[0]), rarely_null(&yes[1]))); break;
    case 7:
        note(fmi3GetDirectionalDerivative(c, vr, n, rarely_null((void *)vr), n, rarely_null(known), m, values, n));
        break;
    case 8: note(fmi3GetAdjointDerivative(c, vr, n, rarely_null((void *)vr), n, rarely_null(known), m, values, n)); break;
    case 9: note(fmi3GetInt32(c, vr, n, numbers, n)); break;
    case 10: note(fmi3GetNumberOfContinuousStates(c, rarely_null(&(size_t){0}))); break;
    case 11: note(fmi3GetNumberOfEventIndicators(c, rarely_null(&(size_t){0}))); break;
    case 12: note(fmi3EvaluateDiscreteStates(c)); break;
    default: note(fmi3GetOutputDerivatives(c, vr, n, numbers, values, n)); break;
    }
}

static int step(Handle c, double time, double length)
{
    bool yes[3];
    double last;
    return fmi3DoStep(c, time, length, true, &yes[0], &yes[1], &yes[2], &last);
}

static int begin(Handle c)
{
    return fmi3EnterInitializationMode(c, false, 0, 0, false, 0) || fmi3ExitInitializationMode(c);
}
#define fmi3GetFMUstate fmi3GetFMUState
#define fmi3SetFMUstate fmi3SetFMUState
#define fmi3FreeFMUstate fmi3FreeFMUState
#define fmi3SerializedFMUstateSize fmi3SerializedFMUStateSize
#define fmi3SerializeFMUstate fmi3SerializeFMUState
#define fmi3DeSerializeFMUstate fmi3DeserializeFMUState
#define fmi3GetDerivatives fmi3GetContinuousStateDerivatives
#endif

/* One call of one of those that both versions have; a saved state is of this FMU, or NULL. */
static void any_call(Handle c, Saved saved[SAVED])
{
    static unsigned char bytes[BYTES];
    static size_t kept;
    unsigned int references[WIDTH];
    double array[WIDTH];
    const size_t n = pick(3) ? pick(3) : pick(WIDTH + 1); /* few: then all are right more often */
    unsigned int *vr = rarely_null(references);
    double *values = rarely_null(array);
    Saved *state = &saved[pick(SAVED)];
    size_t size = 0;
    for (int k = 0; k < WIDTH; k++) {
        references[k] = pick(20) ? pick(N_VARIABLES + N_STATES + N_MODES + 3) : pick(UINT32_MAX / 4) * 4;
        array[k] = any_double();
    }
    switch (pick(30)) { /* half of them go on */
    case 0: note(F(ExitInitializationMode)(c)); break;
    case 1:
        if (pick(4) == 0) note(F(Terminate)(c));
        break;
    case 2:
        if (pick(4) == 0) note(F(Reset)(c));
        break;
    case 3: note(F(EnterEventMode)(c)); break;
    case 4: note(F(EnterContinuousTimeMode)(c)); break;
    case 5: note(F(SetTime)(c, any_double())); break;
    case 6: note(F(SetContinuousStates)(c, values, pick(2) ? N_STATES : n)); break;
    case 7: finite(F(GetContinuousStates)(c, values, pick(2) ? N_STATES : n), values, 0); break;
    case 8: finite(F(GetDerivatives)(c, values, N_STATES), values, N_STATES); break;
    case 9: finite(F(GetEventIndicators)(c, values, pick(2) ? N_MODES : n), values, N_MODES); break;
    case 10: note(F(GetFMUstate)(c, rarely_null(state))); break;
    case 11: note(F(SetFMUstate)(c, *state)); break;
    case 12: note(F(FreeFMUstate)(c, rarely_null(state))); break;
    case 13:
        if (note(F(SerializedFMUstateSize)(c, *state, &size)) != 0 || size > BYTES) break;
        if (note(F(SerializeFMUstate)(c, *state, rarely_null(bytes), pick(3) ? size : pick(BYTES) % size)) == 0)
            kept = size;
        break;
    case 14:
        if (kept > 0 && pick(2)) bytes[pick((unsigned int)kept)] ^= (unsigned char)(1u << pick(8));
        note(F(DeSerializeFMUstate)(c, rarely_null(bytes), pick(3) ? kept : pick((unsigned int)kept + 1), state));
        break;
    case 15: note(F(SetDebugLogging)(c, pick(2) == 0, pick(2), (const char *const[]){rarely_null("logAll")})); break;
    default: specific(c, vr, n, values); break;
    }
}

static int get_all(Handle c, double *values)
{
    unsigned int references[N_VARIABLES];
    for (unsigned int k = 0; k < N_VARIABLES; k++) references[k] = k;
#if FMI == 2
    return fmi2GetReal(c, references, N_VARIABLES, values);
#else
    return fmi3GetFloat64(c, references, N_VARIABLES, values, N_VARIABLES);
#endif
}

static void sequence(void)
{
    Handle instances[INSTANCES] = {NULL};
    Saved saved[SAVED] = {NULL};
    double all[N_VARIABLES];
    for (int k = 0; k < INSTANCES; k++) instances[k] = make(pick(2) == 0, pick(9) ? MODEL_GUID : rarely_null("{}"));
    for (int k = 0; k < INSTANCES; k++)
        if (instances[k] != NULL && pick(2) == 0) note(begin(instances[k]));
    for (int k = 0; k < CALLS; k++) any_call(instances[pick(INSTANCES)], saved);
    for (int k = 0; k < INSTANCES; k++) {
        Handle c = instances[k];
        if (c == NULL) continue;
        finite(get_all(c, all), all, N_VARIABLES);
        if (F(Reset)(c) != 0 || begin(c) != 0) fail("no fresh start after a reset");
        if (!((Instance *)c)->model_exchange && step(c, 0, 1e-3) != 0) fail("no step after a reset");
    }
    for (int k = 0; k < SAVED; k++) {
        Handle c = make(false, MODEL_GUID);
        if (c == NULL || F(FreeFMUstate)(c, &saved[k]) != 0) fail("a saved state cannot be freed");
        F(FreeInstance)(c);
    }
    for (int k = 0; k < INSTANCES; k++) F(FreeInstance)(instances[k]);
}

static void instance(void)
{
    Handle c = make(pick(2) == 0, MODEL_GUID);
    Saved saved = NULL;
    if (c == NULL || begin(c) != 0) fail("no instance");
    if (!((Instance *)c)->model_exchange && step(c, 0, 1e-3) != 0) fail("no step");
    if (F(GetFMUstate)(c, &saved) != 0 || F(FreeFMUstate)(c, &saved) != 0) fail("no state");
    F(FreeInstance)(c);
    calls++, successes++;
}

int main(int count, char **arguments)
{
    if (count < 3) return 2;
    seed = strtoull(arguments[1], NULL, 10) * 2654435769u + 1;
    for (long k = strtol(arguments[2], NULL, 10); k > 0; k--) count > 3 ? instance() : sequence();
    printf("%lu %lu\n", calls, successes);
    return 0;
}
