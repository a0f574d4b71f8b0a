/**
 * @file
 * Calibration of delta printers from their own text, in C99: one call, text in, JSON out.
 *
 * The text is a Klipper printer.cfg or klippy.log (linear and rotary deltas), or a session of a
 * printer with Marlin, RepRapFirmware, Smoothieware or Repetier: settings and probed heights.
 *
 * Unlike truepose.h this allocates, takes up to seconds for hundreds of readings, and needs a C++
 * runtime. It keeps no state: threads may call it at once. */
#ifndef TRUEPOSE_PRINTERS_H
#define TRUEPOSE_PRINTERS_H

#include <stddef.h>

#include "truepose/truepose.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Standard deviations assumed before any reading, by index of truepose_printer_options.sigma. */
enum {
  TRUEPOSE_PRINTER_ARM,       /**< of each arm from nominal, 0.5 mm */
  TRUEPOSE_PRINTER_ANGLE,     /**< of towers a and b against c, 0.25° */
  TRUEPOSE_PRINTER_RADIUS,    /**< 5 mm */
  TRUEPOSE_PRINTER_ENDSTOP,   /**< and of a rotary delta's shoulder height, 2 mm */
  TRUEPOSE_PRINTER_HEIGHT,    /**< of a probed height, 0.04 mm; estimated again */
  TRUEPOSE_PRINTER_DISTANCE,  /**< of a measured distance on a print, 0.04 mm; estimated again */
  TRUEPOSE_PRINTER_SHRINKAGE, /**< of the plastic, 0.2 % */
  TRUEPOSE_PRINTER_WIDTH,     /**< of the pillars between which distances are measured, 0.05 mm */
  TRUEPOSE_PRINTER_SIGMAS
};

/** Settings of truepose_printer(); 0 everywhere is a good start. All are doubles, so that a caller
 * in another language fills one array. */
typedef struct truepose_printer_options {
  double arm_mm;          /**< nominal length of the arms (rotary: lower arms); 0: as in the file */
  double probe_radius_mm; /**< Marlin: radius of G33's points; 0: as printed, where it is */
  double next;            /**< number of next readings to plan, at most 100 */
  double heights_alone;   /**< not 0: plan heights, no distances on a print */
  double sigma[TRUEPOSE_PRINTER_SIGMAS]; /**< mm, ° and %; 0: as above */
} truepose_printer_options;

/** Calibrate a printer.
 *
 * `text` has `length` bytes and need not end with 0; `options` may be null. The answer is one JSON
 * object in UTF-8 without a final 0: `{"error": "one line"}`, or the fit, its judgement, the lines
 * to send and the new configuration (packages/printers/docs/delta-printer.md describes them).
 *
 * @return bytes of the answer; above `capacity` none was written: call again with that many */
TRUEPOSE_API int truepose_printer(const char* text, size_t length,
                                  const truepose_printer_options* options, char* json,
                                  size_t capacity);

/** Nozzle positions x at steps of the motors down from their endstops, `count` rows of 3; NaN where
 * the rods do not meet. `rotary`: 0 or 1; `step`: motion of each motor per step, m or rad; `p` as
 * `p` and `theta` in answers: 10 parameters, of a rotary delta 14.
 *
 * @param slopes  out: ∂x/∂p, `count` matrices of 3 rows */
TRUEPOSE_API void truepose_printer_positions(int rotary, size_t count, const double* step,
                                             const double* p, const double* steps, double* x,
                                             double* slopes);
/** Steps of the motors with the nozzle at x, `count` rows of 3; NaN where it cannot be. */
TRUEPOSE_API void truepose_printer_steps(int rotary, size_t count, const double* step,
                                         const double* p, const double* x, double* steps);

#ifdef __cplusplus
}
#endif

#endif
