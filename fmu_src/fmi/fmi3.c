/* FMI 3.0 Co-Simulation: the API over an instance. Every function reads begin - check - call - end. */
#include "fmi3Functions.h"

#include "instance.h"

/* The standard hands over more than a model of fixed steps without events has a use for. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* The state machine: which call is legal in which states (FMI 3.0.2, sections 2.3 and 4.2). */
enum {
    MAY_SET_DEBUG_LOGGING    = ANY_STATE,
    MAY_ENTER_INITIALIZATION = INSTANTIATED,
    MAY_EXIT_INITIALIZATION  =                INITIALIZATION,
    MAY_TERMINATE            =                                 STEP,
    MAY_RESET                = ANY_STATE,
    MAY_GET                  = INSTANTIATED | INITIALIZATION | STEP | TERMINATED,
    MAY_SET                  = INSTANTIATED | INITIALIZATION | STEP,
    MAY_FMU_STATE            = ANY_STATE,
    MAY_DO_STEP              =                                 STEP,
};

#define CALL(function)                \
    do {                              \
        status = (function);          \
        if (status > STATUS_WARNING) { \
            goto end;                 \
        }                             \
    } while (0)

#define BEGIN(name, states)            \
    Instance *const self = instance;   \
    Status status = STATUS_OK;         \
    if (!self) {                       \
        return fmi3Error;              \
    }                                  \
    CALL(instance_begin(self, name, states));

#define END \
    end:    \
    return (fmi3Status)instance_end(self, status);

/* ---- Creation and log --------------------------------------------------------------------------------------------------------- */

static void emit(const Instance *instance, Status status, const char *category, const char *message)
{
    ((fmi3LogMessageCallback)instance->logger)(instance->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[])
{
    BEGIN("fmi3SetDebugLogging", MAY_SET_DEBUG_LOGGING)
    CALL(instance_set_logging(self, loggingOn, nCategories, categories));
    END
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                         fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    static const char function[] = "fmi3InstantiateCoSimulation";
    void (*const logger)(void) = (void (*)(void))logMessage;
    if (eventModeUsed) {
        return instance_refuse(function, instanceName, emit, logger, instanceEnvironment,
                               "expected eventModeUsed false, as hasEventMode is, but was true");
    }
    if (nRequiredIntermediateVariables) {
        return instance_refuse(function, instanceName, emit, logger, instanceEnvironment,
                               "expected no requiredIntermediateVariables, as no variable has intermediateUpdate, but were some");
    }
    Instance *const self = instance_create(function, instanceName, instantiationToken, emit, logger, instanceEnvironment, loggingOn);
    if (self) {
        self->has_time = 1;
    }
    return self;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                          fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    return instance_refuse("fmi3InstantiateModelExchange", instanceName, emit, (void (*)(void))logMessage, instanceEnvironment,
                           "expected Co-Simulation but was Model Exchange");
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                               fmi3Boolean visible, fmi3Boolean loggingOn,
                                               fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
                                               fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
                                               fmi3UnlockPreemptionCallback unlockPreemption)
{
    return instance_refuse("fmi3InstantiateScheduledExecution", instanceName, emit, (void (*)(void))logMessage, instanceEnvironment,
                           "expected Co-Simulation but was Scheduled Execution");
}

void fmi3FreeInstance(fmi3Instance instance)
{
    instance_free(instance);
}

/* ---- Life cycle --------------------------------------------------------------------------------------------------------------- */

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    BEGIN("fmi3EnterInitializationMode", MAY_ENTER_INITIALIZATION)
    CALL(instance_prepare(self, startTime, stopTimeDefined, stopTime));
    CALL(instance_enter_initialization(self));
    END
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    BEGIN("fmi3ExitInitializationMode", MAY_EXIT_INITIALIZATION)
    CALL(instance_exit_initialization(self));
    END
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    BEGIN("fmi3Terminate", MAY_TERMINATE)
    CALL(instance_terminate(self));
    END
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    BEGIN("fmi3Reset", MAY_RESET)
    CALL(instance_reset(self));
    END
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    BEGIN("fmi3DoStep", MAY_DO_STEP)
    CALL(instance_expect_pointer(self, eventHandlingNeeded, "eventHandlingNeeded"));
    CALL(instance_expect_pointer(self, terminateSimulation, "terminateSimulation"));
    CALL(instance_expect_pointer(self, earlyReturn, "earlyReturn"));
    CALL(instance_expect_pointer(self, lastSuccessfulTime, "lastSuccessfulTime"));
    *eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;
    *lastSuccessfulTime = instance_time(self);
    CALL(instance_do_step(self, currentCommunicationPoint, communicationStepSize, STATUS_DISCARD));
    *lastSuccessfulTime = instance_time(self);
    END
}

/* ---- Variables ---------------------------------------------------------------------------------------------------------------- */

/* All variables are scalars. */
static Status expect_count(const Instance *instance, size_t n_references, size_t n_values)
{
    return n_values == n_references ? STATUS_OK
                                    : instance_log(instance, STATUS_ERROR, "expected nValues %lu but was %lu",
                                                   (unsigned long)n_references, (unsigned long)n_values);
}

#define ACCESS(Type, takes)                                                                                                   \
    fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,      \
                             fmi3##Type values[], size_t nValues) {                                                           \
        BEGIN("fmi3Get" #Type, MAY_GET)                                                                                       \
        CALL(expect_count(self, nValueReferences, nValues));                                                                  \
        CALL(instance_check_get(self, takes, valueReferences, nValueReferences, values));                                     \
        for (size_t k = 0; k < nValues; k++) {                                                                                \
            values[k] = (fmi3##Type)instance_value(self, valueReferences[k]);                                                 \
        }                                                                                                                     \
        END                                                                                                                   \
    }                                                                                                                         \
    fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,      \
                             const fmi3##Type values[], size_t nValues) {                                                     \
        BEGIN("fmi3Set" #Type, MAY_SET)                                                                                       \
        CALL(expect_count(self, nValueReferences, nValues));                                                                  \
        CALL(instance_check_set(self, takes, valueReferences, nValueReferences, values));                                     \
        for (size_t k = 0; k < nValues; k++) {                                                                                \
            CALL(instance_check_value(self, valueReferences[k], (double)values[k]));                                          \
        }                                                                                                                     \
        for (size_t k = 0; k < nValues; k++) {                                                                                \
            instance_assign(self, valueReferences[k], (double)values[k]);                                                     \
        }                                                                                                                     \
        END                                                                                                                   \
    }

ACCESS(Float64, TAKES_FLOAT64)
ACCESS(Int32, TAKES_INT32)
ACCESS(Int64, TAKES_ENUMERATION)
ACCESS(Boolean, TAKES_BOOLEAN)
ACCESS(Float32, TAKES_NONE)
ACCESS(Int8, TAKES_NONE)
ACCESS(UInt8, TAKES_NONE)
ACCESS(Int16, TAKES_NONE)
ACCESS(UInt16, TAKES_NONE)
ACCESS(UInt32, TAKES_NONE)
ACCESS(UInt64, TAKES_NONE)

/* No variable has the types below: legal is only to ask for nothing. */
#define NO_ACCESS(name, states, parameters)                                                                                   \
    fmi3Status fmi3##name parameters {                                                                                        \
        BEGIN("fmi3" #name, states)                                                                                           \
        CALL(instance_check_set(self, TAKES_NONE, valueReferences, nValueReferences, values));                                \
        END                                                                                                                   \
    }

#define REFERENCES fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences
NO_ACCESS(GetString, MAY_GET, (REFERENCES, fmi3String values[], size_t nValues))
NO_ACCESS(SetString, MAY_SET, (REFERENCES, const fmi3String values[], size_t nValues))
NO_ACCESS(GetBinary, MAY_GET, (REFERENCES, size_t valueSizes[], fmi3Binary values[], size_t nValues))
NO_ACCESS(SetBinary, MAY_SET, (REFERENCES, const size_t valueSizes[], const fmi3Binary values[], size_t nValues))
NO_ACCESS(GetClock, MAY_GET, (REFERENCES, fmi3Clock values[]))
NO_ACCESS(SetClock, MAY_SET, (REFERENCES, const fmi3Clock values[]))

/* ---- FMU state ---------------------------------------------------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    BEGIN("fmi3GetFMUState", MAY_FMU_STATE)
    CALL(instance_get_state(self, FMUState));
    END
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    BEGIN("fmi3SetFMUState", MAY_FMU_STATE)
    CALL(instance_set_state(self, FMUState));
    END
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    BEGIN("fmi3FreeFMUState", MAY_FMU_STATE)
    CALL(instance_free_state(self, FMUState));
    END
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    BEGIN("fmi3SerializedFMUStateSize", MAY_FMU_STATE)
    CALL(instance_state_size(self, FMUState, size));
    END
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    BEGIN("fmi3SerializeFMUState", MAY_FMU_STATE)
    CALL(instance_serialize(self, FMUState, serializedState, size));
    END
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState)
{
    BEGIN("fmi3DeserializeFMUState", MAY_FMU_STATE)
    CALL(instance_deserialize(self, serializedState, size, FMUState));
    END
}

/* ---- What these models do not have -------------------------------------------------------------------------------------------- */

#define REFUSE(name, reason, parameters)                                                               \
    fmi3Status fmi3##name parameters {                                                                 \
        BEGIN("fmi3" #name, ANY_STATE)                                                                 \
        CALL(instance_log(self, STATUS_ERROR, "expected no such call (" reason ") but was one"));     \
        END                                                                                            \
    }

#define NO_DEPENDENCIES "providesPerElementDependencies is false"
REFUSE(GetNumberOfVariableDependencies, NO_DEPENDENCIES,
       (fmi3Instance instance, fmi3ValueReference valueReference, size_t *nDependencies))
REFUSE(GetVariableDependencies, NO_DEPENDENCIES,
       (fmi3Instance instance, fmi3ValueReference dependent, size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
        size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[], size_t nDependencies))

REFUSE(GetDirectionalDerivative, "providesDirectionalDerivatives is false",
       (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns, const fmi3ValueReference knowns[],
        size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity))
REFUSE(GetAdjointDerivative, "providesAdjointDerivatives is false",
       (fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns, const fmi3ValueReference knowns[],
        size_t nKnowns, const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity))
REFUSE(GetOutputDerivatives, "maxOutputDerivativeOrder is 0",
       (REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues))

#define NO_STRUCTURE "there are no structural parameters"
REFUSE(EnterConfigurationMode, NO_STRUCTURE, (fmi3Instance instance))
REFUSE(ExitConfigurationMode, NO_STRUCTURE, (fmi3Instance instance))

#define NO_CLOCKS "there are no clocks"
REFUSE(GetIntervalDecimal, NO_CLOCKS, (REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]))
REFUSE(GetIntervalFraction, NO_CLOCKS,
       (REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]))
REFUSE(GetShiftDecimal, NO_CLOCKS, (REFERENCES, fmi3Float64 shifts[]))
REFUSE(GetShiftFraction, NO_CLOCKS, (REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[]))
REFUSE(SetIntervalDecimal, NO_CLOCKS, (REFERENCES, const fmi3Float64 intervals[]))
REFUSE(SetIntervalFraction, NO_CLOCKS, (REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]))
REFUSE(SetShiftDecimal, NO_CLOCKS, (REFERENCES, const fmi3Float64 shifts[]))
REFUSE(SetShiftFraction, NO_CLOCKS, (REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]))
REFUSE(ActivateModelPartition, NO_CLOCKS, (fmi3Instance instance, fmi3ValueReference clockReference, fmi3Float64 activationTime))

#define NO_EVENTS "hasEventMode is false"
REFUSE(EnterEventMode, NO_EVENTS, (fmi3Instance instance))
REFUSE(EnterStepMode, NO_EVENTS, (fmi3Instance instance))
REFUSE(EvaluateDiscreteStates, NO_EVENTS, (fmi3Instance instance))
REFUSE(UpdateDiscreteStates, NO_EVENTS,
       (fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
        fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean *valuesOfContinuousStatesChanged,
        fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime))

#define NO_EXCHANGE "this is no Model Exchange"
REFUSE(EnterContinuousTimeMode, NO_EXCHANGE, (fmi3Instance instance))
REFUSE(CompletedIntegratorStep, NO_EXCHANGE,
       (fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *enterEventMode,
        fmi3Boolean *terminateSimulation))
REFUSE(SetTime, NO_EXCHANGE, (fmi3Instance instance, fmi3Float64 time))
REFUSE(SetContinuousStates, NO_EXCHANGE, (fmi3Instance instance, const fmi3Float64 continuousStates[], size_t nContinuousStates))
REFUSE(GetContinuousStateDerivatives, NO_EXCHANGE, (fmi3Instance instance, fmi3Float64 derivatives[], size_t nContinuousStates))
REFUSE(GetEventIndicators, NO_EXCHANGE, (fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators))
REFUSE(GetContinuousStates, NO_EXCHANGE, (fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates))
REFUSE(GetNominalsOfContinuousStates, NO_EXCHANGE, (fmi3Instance instance, fmi3Float64 nominals[], size_t nContinuousStates))
REFUSE(GetNumberOfEventIndicators, NO_EXCHANGE, (fmi3Instance instance, size_t *nEventIndicators))
REFUSE(GetNumberOfContinuousStates, NO_EXCHANGE, (fmi3Instance instance, size_t *nContinuousStates))
