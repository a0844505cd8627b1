/* The functions that are alike in FMI 2.0 and 3.0 but for their prefix. Knows no model.
 *
 * Included by fmi2.c and fmi3.c, which say what FMI_NAME(name), FMI_STATE(before, after), FMI_READ_STATE and
 * FMI_GET_DERIVATIVES are, and the types FmiInstance, FmiStatus, FmiString, FmiBoolean and FmiByte.
 */

/* A state with the name of the FMU that it is for. */
typedef struct {
    char guid[sizeof MODEL_GUID];
    State state;
} SerializedState;

static FmiStatus fmi_error(FmiInstance c, const char *message)
{
    return (FmiStatus)instance_report(c, INSTANCE_ERROR, "%s", message);
}

static FmiStatus fmi_not_offered(FmiInstance c, const char *function)
{
    if (c == NULL) return FMI_NAME(Error);
    return (FmiStatus)instance_report(c, INSTANCE_ERROR, "%s is not offered by this FMU", function);
}

FmiStatus FMI_NAME(SetDebugLogging)(FmiInstance c, FmiBoolean loggingOn, size_t nCategories,
                                    const FmiString categories[])
{
    Instance *instance = c;
    bool asked[N_LOG_CATEGORIES] = {nCategories == 0};
    if (instance == NULL || (nCategories > 0 && categories == NULL)) return FMI_NAME(Error);
    for (size_t k = 0; k < nCategories; k++) {
        const char *category = categories[k] != NULL ? categories[k] : "";
        int n = 0;
        while (n < N_LOG_CATEGORIES && strcmp(category, log_categories[n].name) != 0) n++;
        if (n == N_LOG_CATEGORIES) return fmi_error(instance, "there is no such log category");
        asked[n] = true;
    }
    instance->log_discard = loggingOn != FMI_NAME(False) && (asked[LOG_ALL] || asked[LOG_DISCARD]);
    instance->log_error = loggingOn != FMI_NAME(False) && (asked[LOG_ALL] || asked[LOG_ERROR]);
    return FMI_NAME(OK);
}

/* ---- Phases ---- */

FmiStatus FMI_NAME(ExitInitializationMode)(FmiInstance c)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_exit_initialization(c);
}

FmiStatus FMI_NAME(Terminate)(FmiInstance c)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_terminate(c);
}

FmiStatus FMI_NAME(Reset)(FmiInstance c)
{
    if (c == NULL) return FMI_NAME(Error);
    instance_reset(c);
    return FMI_NAME(OK);
}

/* ---- State ---- */

static FmiStatus fmi_keep_state(FmiInstance c, const State *state, void **kept)
{
    if (*kept == NULL) *kept = malloc(sizeof(State));
    if (*kept == NULL) return fmi_error(c, "no memory for the FMU state");
    memcpy(*kept, state, sizeof(State));
    return FMI_NAME(OK);
}

FmiStatus FMI_STATE(Get, )(FmiInstance c, void **state)
{
    if (c == NULL || state == NULL) return FMI_NAME(Error);
    return fmi_keep_state(c, &((Instance *)c)->state, state);
}

FmiStatus FMI_STATE(Set, )(FmiInstance c, void *state)
{
    if (c == NULL || state == NULL) return FMI_NAME(Error);
    instance_restore(c, state);
    return FMI_NAME(OK);
}

FmiStatus FMI_STATE(Free, )(FmiInstance c, void **state)
{
    if (c == NULL || state == NULL) return FMI_NAME(Error);
    free(*state);
    *state = NULL;
    return FMI_NAME(OK);
}

FmiStatus FMI_STATE(Serialized, Size)(FmiInstance c, void *state, size_t *size)
{
    if (c == NULL || state == NULL || size == NULL) return FMI_NAME(Error);
    *size = sizeof(SerializedState);
    return FMI_NAME(OK);
}

FmiStatus FMI_STATE(Serialize, )(FmiInstance c, void *state, FmiByte bytes[], size_t size)
{
    SerializedState serialized;
    if (c == NULL || state == NULL || bytes == NULL) return FMI_NAME(Error);
    if (size < sizeof serialized)
        return (FmiStatus)instance_report(c, INSTANCE_ERROR, "a serialised state takes %lu bytes",
                                          (unsigned long)sizeof serialized);
    memset(&serialized, 0, sizeof serialized); /* the same bytes for the same state, padding too */
    memcpy(serialized.guid, MODEL_GUID, sizeof serialized.guid);
    memcpy(&serialized.state, state, sizeof(State));
    memcpy(bytes, &serialized, sizeof serialized);
    return FMI_NAME(OK);
}

FmiStatus FMI_READ_STATE(FmiInstance c, const FmiByte bytes[], size_t size, void **state)
{
    SerializedState serialized;
    if (c == NULL || bytes == NULL || state == NULL) return FMI_NAME(Error);
    if (size >= sizeof serialized) memcpy(&serialized, bytes, sizeof serialized);
    if (size < sizeof serialized || memcmp(serialized.guid, MODEL_GUID, sizeof serialized.guid) != 0 ||
        !instance_is_sane(c, &serialized.state))
        return fmi_error(c, "the serialised state is not of this FMU");
    return fmi_keep_state(c, &serialized.state, state);
}

/* ---- Model exchange: events are changes of mode, and those in which the importer changes a parameter ---- */

FmiStatus FMI_NAME(EnterEventMode)(FmiInstance c)
{
    if (c == NULL) return FMI_NAME(Error);
    return (FmiStatus)instance_enter(c, PHASE_CONTINUOUS, PHASE_EVENT, "entering event mode");
}

FmiStatus FMI_NAME(EnterContinuousTimeMode)(FmiInstance c)
{
    if (c == NULL) return FMI_NAME(Error);
    return (FmiStatus)instance_enter(c, PHASE_EVENT, PHASE_CONTINUOUS, "entering continuous-time mode");
}

FmiStatus FMI_NAME(SetTime)(FmiInstance c, double time)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_set_time(c, time);
}

FmiStatus FMI_NAME(SetContinuousStates)(FmiInstance c, const double states[], size_t count)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_set_states(c, states, count);
}

FmiStatus FMI_NAME(GetContinuousStates)(FmiInstance c, double states[], size_t count)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_get_states(c, OF_STATES, states, count);
}

FmiStatus FMI_GET_DERIVATIVES(FmiInstance c, double derivatives[], size_t count)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_get_states(c, OF_DERIVATIVES, derivatives, count);
}

FmiStatus FMI_NAME(GetNominalsOfContinuousStates)(FmiInstance c, double nominals[], size_t count)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_get_states(c, OF_NOMINALS, nominals, count);
}

FmiStatus FMI_NAME(GetEventIndicators)(FmiInstance c, double indicators[], size_t count)
{
    return c == NULL ? FMI_NAME(Error) : (FmiStatus)instance_get_indicators(c, indicators, count);
}
