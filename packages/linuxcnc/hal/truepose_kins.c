/* LinuxCNC kinematics module for any parallel robot. Guide: ../docs/linuxcnc.md.
 *
 *   loadrt truepose_kins table=FILE [unit=mm|inch|m] [extra=uv]
 *   loadrt truepose_kins pins=genhexkins|lineardeltakins|rotarydeltakins [extra=…]
 *
 * The mathematics is in kins_core.c; this is the interface of LinuxCNC 2.9 and HAL. MIT. */
#define COMPONENT "truepose_kins"
#include "component.h"
#include "kinematics.h"

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

/* Output pins of this module, whatever pins describe the robot. */
static struct says {
  hal_s32_t *status, *part, *iterations, *most_iterations;
  hal_u32_t* refused;
  hal_float_t *conditioning, *least_conditioning, *residual;
  hal_float_t* refused_at[TRUEPOSE_KINS_AXES];
}* says;

static truepose_outcome told; /* refusal in the log, */
static int since;             /* and number of calls since */

/* Pins of genhexkins and switchkins, by the names that configurations use. */
static struct hexapod_pins {
  hal_float_t *base[6][3], *platform[6][3], *base_n[6][3], *platform_n[6][3];
  hal_float_t *correction[6], *gui[6], *shown[6];
  hal_float_t *screw_lead, *spindle_offset, *tool_offset, *criterion, *max_error;
  hal_u32_t *last_iterations, *max_iterations, *limit_iterations;
  hal_bit_t *failed, *is[3];
}* hexapod_pins;

static struct delta_pins {
  hal_float_t* number[4];
}* delta_pins;

static truepose_hexapod hexapod;
static truepose_real delta[4];
static int loaded;      /* the model matches the pins */
static int switched;    /* 0: the robot's kinematics; 1, 2: identity */
static int identity[9]; /* axis of each joint */

static double* axis_of(EmcPose* pose, int axis) {
  double* axes[] = {&pose->tran.x, &pose->tran.y, &pose->tran.z, &pose->a, &pose->b,
                    &pose->c,      &pose->u,      &pose->v,      &pose->w};
  return axes[axis];
}
static void to_axes(const EmcPose* pose, double axes[9]) {
  const double of[] = {pose->tran.x, pose->tran.y, pose->tran.z, pose->a, pose->b,
                       pose->c,      pose->u,      pose->v,      pose->w};
  memcpy(axes, of, sizeof of);
}
static void to_pose(const double axes[9], EmcPose* pose) {
  for (int k = 0; k < 9; ++k) *axis_of(pose, k) = axes[k];
}

static void read_hexapod(truepose_hexapod* to) {
  for (int i = 0; i < 6; ++i)
    for (int k = 0; k < 3; ++k) {
      to->base[i][k] = *hexapod_pins->base[i][k];
      to->platform[i][k] = *hexapod_pins->platform[i][k];
      to->base_n[i][k] = *hexapod_pins->base_n[i][k];
      to->platform_n[i][k] = *hexapod_pins->platform_n[i][k];
    }
  to->spindle_offset = *hexapod_pins->spindle_offset;
  to->tool_offset = *hexapod_pins->tool_offset;
  to->screw_lead = *hexapod_pins->screw_lead;
}

static void extras(void) {
  const int passes = from == FROM_LINEAR_DELTA || from == FROM_ROTARY_DELTA;
  truepose_kins_extras(&kins, *extra != '\0' || !passes ? extra : "abcuvw");
}

/* Updates the robot from the pins: cheap while they are constant. The last pose is kept. */
static int refresh(void) {
  if (from == FROM_HEXAPOD) {
    truepose_hexapod now;
    read_hexapod(&now);
    if (memcmp(&now, &hexapod, sizeof now) != 0) {
      hexapod = now;
      loaded = truepose_kins_hexapod(&kins, &now).status <= TRUEPOSE_OK;
      extras();
    }
    kins.cap = *hexapod_pins->limit_iterations;
    if (kins.cap > 60) kins.cap = 60;
  } else if (from != FROM_TABLE) {
    truepose_real now[4] = {0};
    for (int k = 0; k < (from == FROM_LINEAR_DELTA ? 2 : 4); ++k) now[k] = *delta_pins->number[k];
    if (memcmp(now, delta, sizeof now) != 0) {
      const truepose_linear_delta linear = {now[0], now[1]};
      const truepose_rotary_delta rotary = {now[0], now[1], now[2], now[3]};
      memcpy(delta, now, sizeof now);
      loaded = (from == FROM_LINEAR_DELTA ? truepose_kins_linear_delta(&kins, &linear)
                                          : truepose_kins_rotary_delta(&kins, &rotary))
                   .status <= TRUEPOSE_OK;
      extras();
    }
  }
  kins.least_conditioning = *says->least_conditioning;
  return loaded;
}

/** Keeps the last refusal on the pins; logs it once, and again after AGAIN answers or a change. */
static void say(int forward) {
  enum { AGAIN = 1000 };
  const int refused = kins.outcome.status > TRUEPOSE_OK;
  if (refused) {
    *says->status = kins.refusal.status;
    *says->part = kins.refusal.part;
    ++*says->refused;
    for (int k = 0; k < TRUEPOSE_KINS_AXES; ++k) *says->refused_at[k] = kins.refused[k];
    if (told.status != kins.refusal.status || told.part != kins.refusal.part || since > AGAIN)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_kins: %s refused: %s (chain %d)\n",
                      forward ? "joints" : "a pose", truepose_status_text(kins.refusal.status),
                      kins.refusal.part);
    told = kins.refusal;
    since = 0;
  } else if (since <= AGAIN) {
    ++since;
  }
  if (!forward) *says->conditioning = kins.conditioning;
  *says->iterations = kins.iterations;
  *says->most_iterations = kins.most_iterations;
  *says->residual = kins.residual;
  if (from != FROM_HEXAPOD) return;
  for (int i = 0; i < 6; ++i) *hexapod_pins->correction[i] = kins.screw.correction[i];
  if (!forward) return;
  *hexapod_pins->failed = kins.forward_status > TRUEPOSE_OK;
  *hexapod_pins->last_iterations = kins.iterations;
  *hexapod_pins->max_iterations = kins.most_iterations;
}

int kinematicsForward(const double* joints, EmcPose* pose, const KINEMATICS_FORWARD_FLAGS* fflags,
                      KINEMATICS_INVERSE_FLAGS* iflags) {
  double axes[9], q[9];
  int failed;
  (void)fflags;
  (void)iflags;
  if (!refresh()) return -1;
  to_axes(pose, axes);
  if (from == FROM_HEXAPOD && switched) { /* the pose for a visualisation */
    for (int k = 0; k < 6; ++k) axes[k] = *hexapod_pins->gui[k];
  }
  for (int i = 0; i < 9; ++i) q[i] = i < kins.motors + kins.extras ? joints[i] : 0;
  failed = truepose_kins_forward(&kins, q, axes) > TRUEPOSE_OK;
  say(1);
  if (from == FROM_HEXAPOD) {
    for (int k = 0; k < 6 && !failed; ++k) *hexapod_pins->gui[k] = axes[k];
    if (switched) {
      for (int i = 0; i < 6; ++i)
        if (identity[i] >= 0) *axis_of(pose, identity[i]) = joints[i];
      return 0;
    }
  }
  if (failed) return -1;
  to_pose(axes, pose);
  return 0;
}

int kinematicsInverse(const EmcPose* pose, double* joints, const KINEMATICS_INVERSE_FLAGS* iflags,
                      KINEMATICS_FORWARD_FLAGS* fflags) {
  double axes[9], q[9];
  (void)fflags;
  (void)iflags;
  if (!refresh()) return -1;
  if (switched) {
    for (int i = 0; i < 6; ++i)
      if (identity[i] >= 0) joints[i] = *axis_of((EmcPose*)pose, identity[i]);
    return 0;
  }
  to_axes(pose, axes);
  if (truepose_kins_inverse(&kins, axes, q) > TRUEPOSE_OK) {
    say(0);
    return -1;
  }
  say(0);
  for (int i = 0; i < kins.motors + kins.extras; ++i) joints[i] = q[i];
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

static int say_pins(void) {
  int bad = 0;
  says = hal_malloc(sizeof *says);
  if (says == NULL) return -1;
  bad |= new_s32(&says->status, HAL_OUT, 0, "truepose_kins.status");
  bad |= new_s32(&says->part, HAL_OUT, 0, "truepose_kins.part");
  bad |= new_u32(&says->refused, HAL_OUT, 0, "truepose_kins.refused");
  for (int k = 0; k < TRUEPOSE_KINS_AXES; ++k)
    bad |=
        new_float(&says->refused_at[k], HAL_OUT, 0, "truepose_kins.refused-at.%c", "xyzabcuvw"[k]);
  bad |= new_s32(&says->iterations, HAL_OUT, 0, "truepose_kins.iterations");
  bad |= new_s32(&says->most_iterations, HAL_OUT, 0, "truepose_kins.max-iterations");
  bad |= new_float(&says->residual, HAL_OUT, 0, "truepose_kins.residual");
  bad |= new_float(&says->conditioning, HAL_OUT, 0, "truepose_kins.conditioning");
  bad |= new_float(&says->least_conditioning, HAL_IN, 0.01, "truepose_kins.least-conditioning");
  return bad;
}

static int hexapod_new(void) {
  static const double base[6][3] = {{-22.95, 13.25, 0}, {22.95, 13.25, 0}, {22.95, 13.25, 0},
                                    {0, -26.5, 0},      {0, -26.5, 0},     {-22.95, 13.25, 0}};
  static const double platform[6][3] = {{-1, 11.5, 0},       {1, 11.5, 0},
                                        {10.459, -4.884, 0}, {9.459, -6.616, 0},
                                        {-9.459, -6.616, 0}, {-10.459, -4.884, 0}};
  static const double s = 0.707107, c = 0.866025;
  const double base_n[6][3] = {{s, 0, s}, {0, -s, s}, {-s, 0, s}, {-s, 0, s}, {0, s, s}, {s, 0, s}};
  const double platform_n[6][3] = {{-1, 0, 0},   {c, 0.5, 0},  {c, 0.5, 0},
                                   {c, -0.5, 0}, {c, -0.5, 0}, {-1, 0, 0}};
  int bad = 0;
  struct hexapod_pins* p = hexapod_pins = hal_malloc(sizeof *p);
  if (p == NULL) return -1;
  const struct {
    const char* name;
    hal_float_t* (*pin)[3];
    const double (*value)[3];
  } points[] = {{"base", p->base, base},
                {"platform", p->platform, platform},
                {"base-n", p->base_n, base_n},
                {"platform-n", p->platform_n, platform_n}};
  for (int w = 0; w < 4; ++w)
    for (int i = 0; i < 6; ++i)
      for (int k = 0; k < 3; ++k) {
        bad |= new_float(&points[w].pin[i][k], HAL_IN, points[w].value[i][k], "genhexkins.%s.%d.%c",
                         points[w].name, i, "xyz"[k]);
      }
  for (int i = 0; i < 6; ++i) {
    bad |= new_float(&p->correction[i], HAL_OUT, 0, "genhexkins.correction.%d", i);
    bad |= new_float(&p->gui[i], HAL_IN, 0, "skgui.%c", "xyzabc"[i]);
    bad |= new_float(&p->shown[i], HAL_IN, 0, "genhexkins.%c", "xyzabc"[i]);
  }
  bad |= new_float(&p->screw_lead, HAL_IN, 0, "genhexkins.screw-lead");
  bad |= new_float(&p->spindle_offset, HAL_IN, 0, "genhexkins.spindle-offset");
  bad |= new_float(&p->tool_offset, HAL_IN, 0, "genhexkins.tool-offset");
  bad |= new_float(&p->criterion, HAL_IN, 1e-9, "genhexkins.convergence-criterion");
  bad |= new_float(&p->max_error, HAL_IN, 500, "genhexkins.max-error");
  bad |= new_u32(&p->last_iterations, HAL_OUT, 0, "genhexkins.last-iterations");
  bad |= new_u32(&p->max_iterations, HAL_OUT, 0, "genhexkins.max-iterations");
  bad |= new_u32(&p->limit_iterations, HAL_IN, 0, "genhexkins.limit-iterations");
  bad |= new_bit(&p->failed, HAL_OUT, 0, "genhexkins.fwd-kins-fail");
  for (int k = 0; k < 3; ++k) bad |= new_bit(&p->is[k], HAL_OUT, 0, "kinstype.is-%d", k);
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

static int delta_new(const char* const* names, const double* values, int count) {
  int bad = 0;
  delta_pins = hal_malloc(sizeof *delta_pins);
  if (delta_pins == NULL) return -1;
  for (int k = 0; k < count; ++k)
    bad |= new_float(&delta_pins->number[k], HAL_IN, values[k], "%s", names[k]);
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
  static const char* const linear[] = {"lineardeltakins.R", "lineardeltakins.L"};
  static const double linear_values[] = {131, 269}; /* a valid delta, until the pins are set */
  static const char* const rotary[] = {"rotarydeltakins.platformradius",
                                       "rotarydeltakins.thighlength", "rotarydeltakins.shinlength",
                                       "rotarydeltakins.footradius"};
  static const double rotary_values[] = {10, 10, 14, 6};
  if (*table != '\0' && *pins == '\0') return load_table();
  if (strcmp(pins, "genhexkins") == 0) return from = FROM_HEXAPOD, hexapod_new();
  if (strcmp(pins, "lineardeltakins") == 0)
    return from = FROM_LINEAR_DELTA, delta_new(linear, linear_values, 2);
  if (strcmp(pins, "rotarydeltakins") == 0)
    return from = FROM_ROTARY_DELTA, delta_new(rotary, rotary_values, 4);
  return wrong("pins", pins, "give table=FILE, or genhexkins, lineardeltakins or rotarydeltakins");
}

static int begin(void) { return say_pins() != 0 ? -1 : pins_of_source(); }

void rtapi_app_exit(void) { hal_exit(id); }
