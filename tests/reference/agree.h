/* Difference of this build's answers from the reference's. */
#ifndef TRUEPOSE_AGREE_H
#define TRUEPOSE_AGREE_H

#include "truepose/truepose.h"

enum {
  AGREE_IKM,
  AGREE_FKM,
  AGREE_READINGS,
  AGREE_JACOBIAN,
  AGREE_TEJ,
  AGREE_ERROR,
  AGREE_ESTIMATE,
  AGREE_QUESTIONS
};

/** Names of the questions. */
extern const char* const agree_names[AGREE_QUESTIONS];

/** Asks all of every robot whose mobility is compiled.
 *
 * @param worst  out: largest difference over the size of the compared quantity
 * @return how many robots were asked; below 0: the (-n)th robot had no answer to something
 */
int32_t agree(truepose_real worst[AGREE_QUESTIONS]);

/** What a difference may be: 1e-13, of the estimate, whose search ends a hundred-thousandth of a
 * sigma away, 1e-10. In single precision, whose rounding is 6e-8, 1e-6, and 5e-6 of the forward
 * model, which a 3-RRR near its singularity enlarges. */
truepose_real agree_within(int question);

#endif
