/* Geometry that arrives while the machine works. */
#include "exchange_core.h"

#include <math.h>
#include <string.h>

/** s without a byte after which the next one begins a table. */
static const truepose_real kPause = 1;

void truepose_exchange_begin(truepose_exchange* exchange) {
  truepose_table_begin(&exchange->reader, &exchange->table[exchange->arrives]);
  exchange->step = 0;
}

static void refuse(truepose_exchange* exchange, truepose_exchange_state state, const char* why) {
  truepose_exchange_begin(exchange);
  exchange->state = state;
  exchange->why = why;
  ++exchange->refused;
}

static void receive(truepose_exchange* exchange, const unsigned char* bytes, size_t count) {
  while (count > 0 && exchange->step >= 0) {
    if (exchange->step > 0) truepose_exchange_begin(exchange);
    const size_t some = count < exchange->reader.room ? count : exchange->reader.room;
    memcpy(exchange->reader.at, bytes, some);
    const char* const why = truepose_table_got(&exchange->reader, some);
    bytes += some;
    count -= some;
    exchange->step = exchange->reader.complete;
    exchange->state = exchange->step ? TRUEPOSE_EXCHANGE_TESTED : TRUEPOSE_EXCHANGE_ARRIVES;
    if (why == NULL) continue;
    refuse(exchange, TRUEPOSE_EXCHANGE_INVALID, why);
    exchange->step = -1;
  }
}

/** Whether two robots differ in their geometry alone. */
static int alike(const truepose_table* a, const truepose_table* b) {
  const truepose_description *const one = &a->finest, *const other = &b->finest;
  const size_t kinds = offsetof(truepose_description, mobility);
  int same = a->monitored && b->monitored && memcmp(a->name, b->name, sizeof a->name) == 0 &&
             memcmp(&one->mobility, &other->mobility,
                    offsetof(truepose_description, gravity) - kinds) == 0;
  for (int i = 0; same && i < one->chains; ++i)
    same = memcmp(&one->chain[i], &other->chain[i], offsetof(truepose_chain, base)) == 0;
  for (int k = 0; same && k < one->sensors; ++k)
    same = memcmp(&one->sensor[k], &other->sensor[k], offsetof(truepose_sensor, gain)) == 0;
  return same;
}

/** Whether the law in use has an answer, with corrections that are allowed. */
static int corrects(truepose_corrector* tej, const truepose_corrector_input* in,
                    const truepose_knowledge* known, const truepose_real* q_e) {
  truepose_pupil* const pupil = &tej->pupil;
  const int weighs = in->law == TRUEPOSE_LAW_WEIGHTED || in->law == TRUEPOSE_LAW_ESTIMATED;
  truepose_servo_cycle cycle;
  if (in->law == TRUEPOSE_LAW_JOINT) return 1;
  if (truepose_servo(weighs ? &pupil->next_finest : &pupil->next, in->law, in->band, tej->x_d, q_e,
                     weighs ? known : NULL, weighs ? tej->work : NULL, &cycle)
          .status > TRUEPOSE_OK)
    return 0;
  int allowed = 1;
  for (int i = 0; i < tej->motors; ++i)
    allowed &= fabs(cycle.error[i] - (in->q_d[i] - q_e[i])) <= in->largest[i];
  return allowed;
}

/** Makes the next step of the test. @return the state that follows; `why` of an invalid table */
static truepose_exchange_state test(truepose_exchange* exchange, truepose_corrector* tej,
                                    const truepose_corrector_input* in, const char** why) {
  const truepose_table* const table = &exchange->table[exchange->arrives];
  truepose_pupil* const pupil = &tej->pupil;
  truepose_real q_e[TRUEPOSE_READINGS];
  truepose_outcome outcome = {TRUEPOSE_OK, -1};
  if (in->learn || pupil->lines + pupil->left_out > 0) return TRUEPOSE_EXCHANGE_LEARNS;
  if (exchange->step > 2) { /* with readings */
    if (!in->enable || !in->referenced || tej->fault != TRUEPOSE_TEJ_NO_FAULT || tej->doubted)
      return TRUEPOSE_EXCHANGE_TESTED;
    memcpy(q_e, in->q_e, sizeof q_e);
    for (int i = 0; i < tej->motors; ++i) q_e[i] -= tej->homed_by[i];
  }
  switch (exchange->step++) {
    case 1:
      if (!alike(table, &tej->table) ||
          truepose_work(&pupil->drawn, table->known.count) > TRUEPOSE_TEJ_WORK)
        return TRUEPOSE_EXCHANGE_OTHER;
      outcome = truepose_load(&pupil->next_finest, sizeof pupil->next_finest, &table->finest);
      break;
    case 2: outcome = truepose_pupil_load(pupil); break;
    case 3:
      memcpy(pupil->x, tej->pose, sizeof pupil->x); /* the forward model begins there */
      outcome = truepose_pupil_accuracy(pupil, &pupil->next_finest, &table->known, q_e, in->chi2,
                                        tej->work);
      return outcome.status == TRUEPOSE_OK || outcome.status == TRUEPOSE_NEAR_SINGULAR
                 ? TRUEPOSE_EXCHANGE_TESTED
                 : TRUEPOSE_EXCHANGE_READINGS;
    default:
      if (!corrects(tej, in, &table->known, q_e)) return TRUEPOSE_EXCHANGE_CORRECTION;
      truepose_pupil_adopt(pupil);
      pupil->known = table->known;
      tej->given = tej->exchanged = 1;
      ++exchange->used;
      exchange->arrives ^= 1;
      truepose_exchange_begin(exchange);
      return TRUEPOSE_EXCHANGE_USED;
  }
  *why = truepose_status_text(outcome.status);
  return outcome.status > TRUEPOSE_OK ? TRUEPOSE_EXCHANGE_INVALID : TRUEPOSE_EXCHANGE_TESTED;
}

void truepose_exchange_cycle(truepose_exchange* exchange, const unsigned char* bytes, size_t count,
                             truepose_corrector* tej, const truepose_corrector_input* in) {
  static const char* const texts[] = {
      "is of another robot, or has other sensors", "the machine's readings contradict it",
      "its correction exceeds largest-correction", "online calibration is on: one of the two"};
  exchange->since = count > 0 ? 0 : exchange->since + tej->period;
  if (count > 0) {
    receive(exchange, bytes, count);
  } else if (exchange->step > 0) {
    const char* why = NULL;
    const truepose_exchange_state state = test(exchange, tej, in, &why);
    exchange->state = state;
    if (state > TRUEPOSE_EXCHANGE_INVALID) why = texts[state - TRUEPOSE_EXCHANGE_OTHER];
    if (state > TRUEPOSE_EXCHANGE_USED) refuse(exchange, state, why);
  } else if (exchange->since > kPause && exchange->state == TRUEPOSE_EXCHANGE_ARRIVES) {
    refuse(exchange, TRUEPOSE_EXCHANGE_INVALID, "ends too early");
  } else if (exchange->since > kPause) {
    exchange->step = 0;
  }
}
