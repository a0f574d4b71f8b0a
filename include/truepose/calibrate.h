/**
 * @file
 * Batch calibration of a robot from a log of its own readings, in C99: the fit of tp.calibrate.
 *
 * Unlike truepose.h this is for computers without a deadline: it allocates, takes as long as the
 * log is, and needs the C++ standard library. CMake's target: truepose_offline. */
#ifndef TRUEPOSE_CALIBRATE_H
#define TRUEPOSE_CALIBRATE_H

#include "truepose/truepose.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Influence of gross errors: none, rows that all others contradict are left out; or all. */
typedef enum truepose_loss { TRUEPOSE_LOSS_STUDENT = 0, TRUEPOSE_LOSS_SQUARES = 1 } truepose_loss;

/** Readings at unknown poses, m and rad, without padding between rows; NaN: not read. */
typedef struct truepose_log {
  int32_t rows;
  int32_t loss;             /**< a truepose_loss; 0 is the default */
  const double* readings;   /**< rows × (n + r) */
  const double* measured;   /**< rows × n: pose measured in the base frame; may be null */
  double measured_sigma[6]; /**< of every coordinate, > 0 */
} truepose_log;

/** Result of a calibration. The arrays are the caller's; those that are null are not filled. */
typedef struct truepose_calibration {
  truepose_outcome outcome; /**< `part`: the invalid column or coordinate */
  int32_t iterations;
  int32_t used;  /**< rows with a pose; of the others `status` has the reason */
  double cost;   /**< of the least squares, with the prior */
  double rms;    /**< residuals of rows that are no outliers, in sigma: 1 on average for a correct
                    model */
  double* value; /**< p identified values, in the prior's order */
  double* covariance; /**< p × p */
  double* x;          /**< rows × n: estimated poses; NaN without one */
  double* chi2;       /**< rows: squared residual, in units of sigma; NaN without a pose */
  int32_t* status;    /**< rows: a truepose_status */
} truepose_calibration;

/** Identifies geometry, maximum a posteriori, poses unknown, at the model's level.
 * @param drawn   nominal model
 * @param prior   uncertain parameters and sigma of the readings
 * @param mean    p prior means; null: the model's own values
 * @param result  in: its arrays; out. Unchanged but for `outcome` unless that is OK
 * @return its outcome: UNFINISHED; NO_SUCH_PART: no row or parameter, an invalid column or loss;
 * NO_SUCH_VALUE: a sigma; NOT_MEASURED: no reading beyond those that give the poses; UNREACHABLE:
 * no row closes the loops; NOT_CONVERGED, SINGULAR, NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_calibrate(const truepose_model* drawn,
                                                 const truepose_knowledge* prior,
                                                 const double* mean, const truepose_log* log,
                                                 truepose_calibration* result);

/** The model with other values of some parameters, as identified, or in error for a simulation.
 * @param column  of H_xi, `count` of them, as in a truepose_knowledge
 * @param model   out; may be `drawn`
 * @return UNFINISHED; NO_SUCH_PART: a column; TOO_SMALL; NO_SUCH_VALUE and others of truepose_load
 */
TRUEPOSE_API truepose_outcome truepose_with_parameters(const truepose_model* drawn, int32_t count,
                                                       const int32_t* column, const double* value,
                                                       truepose_model* model, size_t size);

#ifdef __cplusplus
}
#endif

#endif
