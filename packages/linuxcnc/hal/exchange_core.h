/* Geometry and knowledge that arrive while the machine works, as the bytes of a table: what
 * `truepose follow` has identified. Independent of LinuxCNC.
 *
 * A cycle copies the bytes of its call, or makes one step of the test: load the robot at one level,
 * then at the other; χ² of the machine's readings; the correction of the law. Then the laws use it
 * as the identified robot. A refused table changes no correction. */
#ifndef TRUEPOSE_LINUXCNC_EXCHANGE_CORE_H
#define TRUEPOSE_LINUXCNC_EXCHANGE_CORE_H

#include "tej_core.h"

typedef enum truepose_exchange_state {
  TRUEPOSE_EXCHANGE_NONE = 0,
  TRUEPOSE_EXCHANGE_ARRIVES = 1,
  TRUEPOSE_EXCHANGE_TESTED = 2, /**< as soon as the drives are on and all readings valid */
  TRUEPOSE_EXCHANGE_USED = 3,
  TRUEPOSE_EXCHANGE_INVALID = 4,    /**< the bytes are no complete table of a robot */
  TRUEPOSE_EXCHANGE_OTHER = 5,      /**< another robot, or other sensors */
  TRUEPOSE_EXCHANGE_READINGS = 6,   /**< the machine's readings contradict it */
  TRUEPOSE_EXCHANGE_CORRECTION = 7, /**< its correction is larger than allowed */
  TRUEPOSE_EXCHANGE_LEARNS = 8      /**< the component identifies the robot itself */
} truepose_exchange_state;

typedef struct truepose_exchange {
  truepose_table table[2]; /**< one arrives, the other is in use */
  truepose_table_reader reader;
  int32_t arrives;     /**< the first's index */
  int32_t step;        /**< of the test; 0: bytes are expected, -1: ignored, until they pause */
  truepose_real since; /**< s since the last byte */
  /* out */
  int32_t state;          /**< a truepose_exchange_state */
  uint32_t used, refused; /**< numbers of tables */
  const char* why;        /**< short reason of the last refusal */
} truepose_exchange;

/** Expects a table. */
void truepose_exchange_begin(truepose_exchange* exchange);
/** Runs one cycle, after the corrector's. Bytes of a newer table end the test of an older one.
 * @param count  of the bytes that have arrived */
void truepose_exchange_cycle(truepose_exchange* exchange, const unsigned char* bytes, size_t count,
                             truepose_corrector* tej, const truepose_corrector_input* in);

#endif
