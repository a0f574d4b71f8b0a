/* LinuxCNC kinematics module for any parallel robot. Guide: ../docs/linuxcnc.md.
 *
 *   loadrt truepose_kins table=FILE [unit=mm|inch|m] [extra=uv]
 *   loadrt truepose_kins pins=genhexkins|lineardeltakins|rotarydeltakins [extra=…]
 *
 * The mathematics is in kins_core.c; this is the interface of LinuxCNC 2.9 and HAL. MIT. */
#define COMPONENT "truepose_kins"
#define PINS(PIN)                                                                \
  PIN(ONE, s32, OUT, status, "status", 0, told.status)                           \
  PIN(ONE, s32, OUT, part, "part", 0, told.part)                                 \
  PIN(ONE, u32, OUT, refused, "refused", 0)                                      \
  PIN(AXIS, float, OUT, refused_at, "refused-at", 0)                             \
  PIN(ONE, s32, OUT, iterations, "iterations", 0, kins.iterations)               \
  PIN(ONE, s32, OUT, most_iterations, "max-iterations", 0, kins.most_iterations) \
  PIN(ONE, float, OUT, residual, "residual", 0, kins.residual)                   \
  PIN(ONE, float, OUT, conditioning, "conditioning", 0, kins.conditioning)       \
  PIN(ONE, float, IN, least_conditioning, "least-conditioning", 0.01)
#include "kinematics.h"
#include "pins.h"

#include "geometry.h"

MODULE_DESCRIPTION("Kinematics of parallel robots that refuses what cannot be stood at");

static char* pins = "";
RTAPI_MP_STRING(pins,
                "whose pins describe the robot: genhexkins, lineardeltakins, rotarydeltakins");
static char* extra = "";
RTAPI_MP_STRING(extra, "axis letters of joints beyond the robot's motors");
static char* coordinates = "xyzabc";
RTAPI_MP_STRING(coordinates, "axis letters of the joints under identity kinematics (genhexkins)");

typedef enum source { FROM_TABLE, FROM_HEXAPOD, FROM_LINEAR_DELTA, FROM_ROTARY_DELTA } source;
static source from;
static truepose_kins kins;

static truepose_outcome told; /* refusal in the log, */
static int since;             /* and number of calls since */

/* Pins of genhexkins and switchkins besides those that describe the robot. */
static struct hexapod_pins {
  hal_float_t *correction[6], *gui[6], *shown[6];
  hal_float_t *criterion, *max_error;
  hal_u32_t *last_iterations, *max_iterations, *limit_iterations;
  hal_bit_t *failed, *is[3];
}* hexapod_pins;

/* Numbers that describe the robot, and their pins, by the names that configurations use. */
enum { NUMBERS = sizeof(truepose_hexapod) / sizeof(truepose_real) };
typedef union geometry {
  truepose_real number[NUMBERS];
  truepose_hexapod hexapod;
  truepose_linear_delta linear_delta;
  truepose_rotary_delta rotary_delta;
} geometry;
static geometry described;
static hal_float_t** number;
static int numbers;
static int loaded;      /* the model matches the pins */
static int switched;    /* 0: the robot's kinematics; 1, 2: identity */
static int identity[9]; /* axis of each joint */

_Static_assert(sizeof(EmcPose) == 9 * sizeof(double), "x, y, z, a, b, c, u, v, w");

/* Updates the robot from the pins: cheap while they are constant. The last pose is kept. */
static int refresh(void) {
  if (from != FROM_TABLE) {
    geometry now = {{0}};
    for (int k = 0; k < numbers; ++k) now.number[k] = *number[k];
    if (memcmp(&now, &described, sizeof now) != 0) {
      described = now;
      loaded = (from == FROM_HEXAPOD        ? truepose_kins_hexapod(&kins, &now.hexapod)
                : from == FROM_LINEAR_DELTA ? truepose_kins_linear_delta(&kins, &now.linear_delta)
                                            : truepose_kins_rotary_delta(&kins, &now.rotary_delta))
                   .status <= TRUEPOSE_OK;
      truepose_kins_extras(&kins, *extra != '\0' || from == FROM_HEXAPOD ? extra : "abcuvw");
    }
  }
  if (from == FROM_HEXAPOD) {
    kins.cap = *hexapod_pins->limit_iterations;
    if (kins.cap > 60) kins.cap = 60;
  }
  kins.least_conditioning = *pin->least_conditioning;
  return loaded;
}

/** Keeps the last refusal on the pins; logs it once, and again after AGAIN answers or a change. */
static void say(int forward) {
  enum { AGAIN = 1000 };
  const int refused = kins.outcome.status > TRUEPOSE_OK;
  if (refused) {
    ++*pin->refused;
    for (int k = 0; k < TRUEPOSE_KINS_AXES; ++k) *pin->refused_at[k] = kins.refused[k];
    if (told.status != kins.refusal.status || told.part != kins.refusal.part || since > AGAIN)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_kins: %s refused: %s (chain %d)\n",
                      forward ? "joints" : "a pose", truepose_status_text(kins.refusal.status),
                      kins.refusal.part);
    told = kins.refusal;
    since = 0;
  } else if (since <= AGAIN) {
    ++since;
  }
  PINS(TRUEPOSE_SHOW)
  if (from != FROM_HEXAPOD) return;
  for (int i = 0; i < 6; ++i) *hexapod_pins->correction[i] = kins.screw.correction[i];
  if (!forward) return;
  *hexapod_pins->failed = refused;
  *hexapod_pins->last_iterations = kins.iterations;
  *hexapod_pins->max_iterations = kins.most_iterations;
}

int kinematicsForward(const double* joints, EmcPose* pose, const KINEMATICS_FORWARD_FLAGS* fflags,
                      KINEMATICS_INVERSE_FLAGS* iflags) {
  double axes[9], q[9] = {0};
  if (!refresh()) return -1;
  memcpy(axes, pose, sizeof axes);
  if (from == FROM_HEXAPOD && switched) { /* the pose for a visualisation */
    for (int k = 0; k < 6; ++k) axes[k] = *hexapod_pins->gui[k];
  }
  memcpy(q, joints, (kins.motors + kins.extras) * sizeof *q);
  const int failed = truepose_kins_forward(&kins, q, axes) > TRUEPOSE_OK;
  say(1);
  if (from == FROM_HEXAPOD) {
    for (int k = 0; k < 6 && !failed; ++k) *hexapod_pins->gui[k] = axes[k];
    if (switched) {
      for (int i = 0; i < 6; ++i)
        if (identity[i] >= 0) ((double*)pose)[identity[i]] = joints[i];
      return 0;
    }
  }
  if (failed) return -1;
  memcpy(pose, axes, sizeof axes);
  return 0;
}

int kinematicsInverse(const EmcPose* pose, double* joints, const KINEMATICS_INVERSE_FLAGS* iflags,
                      KINEMATICS_FORWARD_FLAGS* fflags) {
  double axes[9], q[9];
  if (!refresh()) return -1;
  if (switched) {
    for (int i = 0; i < 6; ++i)
      if (identity[i] >= 0) joints[i] = ((const double*)pose)[identity[i]];
    return 0;
  }
  memcpy(axes, pose, sizeof axes);
  const int failed = truepose_kins_inverse(&kins, axes, q) > TRUEPOSE_OK;
  say(0);
  if (failed) return -1;
  memcpy(joints, q, (kins.motors + kins.extras) * sizeof *q);
  return 0;
}

KINEMATICS_TYPE kinematicsType(void) { return KINEMATICS_BOTH; }
int kinematicsSwitchable(void) { return from == FROM_HEXAPOD; }
int kinematicsSwitch(int type) {
  if (from != FROM_HEXAPOD || type < 0 || type > 2) return -1;
  switched = type;
  for (int k = 0; k < 3; ++k) *hexapod_pins->is[k] = k == type;
  return 0;
}
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsSwitchable);
EXPORT_SYMBOL(kinematicsSwitch);

static int hexapod_new(void) {
  static const char* const offsets[] = {"spindle-offset", "tool-offset", "screw-lead"};
  const double s = 0.707107, c = 0.866025;
  const struct {
    const char* name;
    double value[6][3];
  } points[] = {{"base",
                 {{-22.95, 13.25, 0},
                  {22.95, 13.25, 0},
                  {22.95, 13.25, 0},
                  {0, -26.5, 0},
                  {0, -26.5, 0},
                  {-22.95, 13.25, 0}}},
                {"platform",
                 {{-1, 11.5, 0},
                  {1, 11.5, 0},
                  {10.459, -4.884, 0},
                  {9.459, -6.616, 0},
                  {-9.459, -6.616, 0},
                  {-10.459, -4.884, 0}}},
                {"base-n", {{s, 0, s}, {0, -s, s}, {-s, 0, s}, {-s, 0, s}, {0, s, s}, {s, 0, s}}},
                {"platform-n",
                 {{-1, 0, 0}, {c, 0.5, 0}, {c, 0.5, 0}, {c, -0.5, 0}, {c, -0.5, 0}, {-1, 0, 0}}}};
  int bad = 0;
  struct hexapod_pins* p = hexapod_pins = hal_malloc(sizeof *p);
  if (p == NULL) return -1;
  for (int w = 0; w < 4; ++w)
    for (int i = 0; i < 6; ++i)
      for (int k = 0; k < 3; ++k)
        bad |= new_pin(HAL_FLOAT, &number[numbers++], HAL_IN, points[w].value[i][k],
                       "genhexkins.%s.%d.%c", points[w].name, i, "xyz"[k]);
  for (int k = 0; k < 3; ++k)
    bad |= new_pin(HAL_FLOAT, &number[numbers++], HAL_IN, 0, "genhexkins.%s", offsets[k]);
  for (int i = 0; i < 6; ++i) {
    bad |= new_pin(HAL_FLOAT, &p->correction[i], HAL_OUT, 0, "genhexkins.correction.%d", i);
    bad |= new_pin(HAL_FLOAT, &p->gui[i], HAL_IN, 0, "skgui.%c", "xyzabc"[i]);
    bad |= new_pin(HAL_FLOAT, &p->shown[i], HAL_IN, 0, "genhexkins.%c", "xyzabc"[i]);
  }
  bad |= new_pin(HAL_FLOAT, &p->criterion, HAL_IN, 1e-9, "genhexkins.convergence-criterion");
  bad |= new_pin(HAL_FLOAT, &p->max_error, HAL_IN, 500, "genhexkins.max-error");
  bad |= new_pin(HAL_U32, &p->last_iterations, HAL_OUT, 0, "genhexkins.last-iterations");
  bad |= new_pin(HAL_U32, &p->max_iterations, HAL_OUT, 0, "genhexkins.max-iterations");
  bad |= new_pin(HAL_U32, &p->limit_iterations, HAL_IN, 0, "genhexkins.limit-iterations");
  bad |= new_pin(HAL_BIT, &p->failed, HAL_OUT, 0, "genhexkins.fwd-kins-fail");
  for (int k = 0; k < 3; ++k) bad |= new_pin(HAL_BIT, &p->is[k], HAL_OUT, 0, "kinstype.is-%d", k);
  if (bad == 0) {
    *p->limit_iterations = 120;
    kinematicsSwitch(0);
    memset(identity, -1, sizeof identity);
    for (int i = 0; i < 6 && coordinates[i] != '\0'; ++i)
      for (int k = 0; k < 9; ++k)
        if ((coordinates[i] | 0x20) == "xyzabcuvw"[k]) identity[i] = k;
  }
  return bad;
}

static int load_table(void) {
  static truepose_table read;
  if (read_parameters(&read) != 0 ||
      refused("table", table, truepose_kins_load(&kins, &read.robot, truepose_unit(unit))) != 0)
    return -1;
  if (!truepose_kins_extras(&kins, extra))
    return wrong("extra", extra, "choose letters of xyzabcuvw that the robot does not move itself");
  loaded = 1;
  return 0;
}

static int pins_of_source(void) {
  static const char* const names[] = {"genhexkins", "lineardeltakins", "rotarydeltakins"};
  static const struct {
    const char* name;
    double value; /* of a valid delta, until the pins are set */
  } delta[2][4] = {
      {{"R", 131}, {"L", 269}},
      {{"platformradius", 10}, {"thighlength", 10}, {"shinlength", 14}, {"footradius", 6}}};
  int bad = 0;
  if (*table != '\0' && *pins == '\0') return load_table();
  for (from = FROM_HEXAPOD; strcmp(pins, names[from - FROM_HEXAPOD]) != 0; ++from)
    if (from == FROM_ROTARY_DELTA)
      return wrong("pins", pins,
                   "give table=FILE, or genhexkins, lineardeltakins or rotarydeltakins");
  number = hal_malloc(NUMBERS * sizeof *number);
  if (number == NULL) return -1;
  if (from == FROM_HEXAPOD) return hexapod_new();
  for (; numbers < 4 && delta[from - FROM_LINEAR_DELTA][numbers].name != NULL; ++numbers)
    bad |=
        new_pin(HAL_FLOAT, &number[numbers], HAL_IN, delta[from - FROM_LINEAR_DELTA][numbers].value,
                "%s.%s", pins, delta[from - FROM_LINEAR_DELTA][numbers].name);
  return bad;
}

static int begin(void) { return make_pins() != 0 ? -1 : pins_of_source(); }

void rtapi_app_exit(void) { hal_exit(id); }
