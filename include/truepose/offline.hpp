/// @file
/// What takes its time, and memory: the exact plant, its effects and faults, statics, stretch,
/// calibration of logs, the accuracy to be had, assembly modes. Not for the control path
/// (truepose/core.hpp).
#pragma once

#include "truepose/core.hpp"
#include "truepose/offline/assembly.hpp"
#include "truepose/offline/bound.hpp"
#include "truepose/offline/calibrate.hpp"
#include "truepose/offline/effects.hpp"
#include "truepose/offline/fastest.hpp"
#include "truepose/offline/faults.hpp"
#include "truepose/offline/registration.hpp"
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/statics.hpp"
#include "truepose/offline/stretch.hpp"
