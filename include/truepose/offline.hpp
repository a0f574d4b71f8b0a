/// @file
/// Functions that take time and memory, not for the control path (truepose/core.hpp): plant,
/// effects, faults, statics, compliance, calibration of logs, attainable accuracy, assembly modes.
#pragma once

#include "truepose/core.hpp"
#include "truepose/offline/assembly.hpp"
#include "truepose/offline/bound.hpp"
#include "truepose/offline/calibrate.hpp"
#include "truepose/offline/effects.hpp"
#include "truepose/offline/fastest.hpp"
#include "truepose/offline/faults.hpp"
#include "truepose/offline/registration.hpp"
#include "truepose/offline/safety_defaults.hpp"
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/start_simulation.hpp"
#include "truepose/offline/statics.hpp"
#include "truepose/offline/stretch.hpp"
