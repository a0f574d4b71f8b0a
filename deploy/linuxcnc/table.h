/* What a LinuxCNC component is told of a robot: the file that `truepose export linuxcnc` writes.
 *
 * Behind eight letters it is a row of blocks, each four letters, its length and its bytes, in the
 * order and sizes of the machine that wrote it; truepose_load() refuses another's. */
#ifndef TRUEPOSE_LINUXCNC_TABLE_H
#define TRUEPOSE_LINUXCNC_TABLE_H

#include "truepose/truepose.h"

enum { TRUEPOSE_TABLE_PARAMETERS = 256 }; /**< uncertain ones, at most */

/** A robot, as the controller believes it to be, and how it is watched. */
typedef struct truepose_table {
  truepose_description robot;
  truepose_description finest; /**< for laws that weigh, and for the watch */
  truepose_fault_monitor_settings watch;
  truepose_knowledge known; /**< count 0: no sensors, or nothing that is uncertain */
  int32_t column[TRUEPOSE_TABLE_PARAMETERS];
  truepose_real root[TRUEPOSE_TABLE_PARAMETERS * TRUEPOSE_TABLE_PARAMETERS];
  int32_t watched; /**< 1: there are `watch` and `known` */
  uint64_t from;   /**< marks the exported table that this is, or was learnt from */
} truepose_table;

/** Reads a table. May wait and allocate: while a component is loaded, not later.
 *
 * @return null, or in a few words what is wrong with the file
 */
const char* truepose_read_table(const char* path, truepose_table* table);

/** Writes what was learnt as a table, in place of the robot, its finest level and the knowledge
 * that `began` has. May wait and allocate. @return null, or in a few words why it is not written */
const char* truepose_write_table(const char* path, const truepose_description* robot,
                                 const truepose_description* finest,
                                 const truepose_knowledge* known, const truepose_table* began);

/** rad or m in a machine unit of a reading, counted as in q_e: angles are in degrees.
 * @param unit  m in a machine unit of length */
truepose_real truepose_reading_scale(const truepose_description* robot, int reading,
                                     truepose_real unit);
/** rad or m in a machine unit of a freedom of the pose. */
truepose_real truepose_freedom_scale(const truepose_description* robot, int freedom,
                                     truepose_real unit);
/** m in the unit of a name, mm, inch or m; 0: of another. */
truepose_real truepose_unit(const char* name);

#endif
