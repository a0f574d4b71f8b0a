/* Table of a robot for the LinuxCNC components: a file of `truepose export linuxcnc`, or the bytes
 * that `truepose linuxcnc` sends to a pin.
 *
 * After eight letters it is a sequence of blocks: four letters, length and bytes, in the order and
 * sizes of the writing machine; truepose_load() refuses those of another. The last block is a mark
 * (FNV-1a) of all bytes before it. */
#ifndef TRUEPOSE_LINUXCNC_TABLE_H
#define TRUEPOSE_LINUXCNC_TABLE_H

#include "truepose/truepose.h"

enum { TRUEPOSE_STEPS = 12 }; /**< most of the forward model: commands move little per cycle */
enum { TRUEPOSE_TABLE_PARAMETERS = 256 }; /**< maximum number of uncertain parameters */

/** The controller's model of a robot, and the settings of its fault monitor. */
typedef struct truepose_table {
  char name[32]; /**< the robot file's, padded by zeros */
  truepose_description robot;
  truepose_description finest; /**< for weighted laws and the fault monitor */
  truepose_fault_monitor_settings monitor;
  truepose_knowledge known; /**< count 0: no sensors, or nothing uncertain */
  int32_t column[TRUEPOSE_TABLE_PARAMETERS];
  truepose_real root[TRUEPOSE_TABLE_PARAMETERS * TRUEPOSE_TABLE_PARAMETERS];
  int32_t monitored; /**< 1: `monitor` and `known` are present */
  uint64_t from;     /**< mark of the exported table that this is, or was identified from */
  uint64_t mark;     /**< of its own bytes */
} truepose_table;

/** Head of a block. */
typedef struct truepose_table_block {
  char name[4];
  uint32_t length;
} truepose_table_block;

/** Reads a table in pieces, without waiting or allocating. */
typedef struct truepose_table_reader {
  unsigned char* at; /**< where the next bytes belong, */
  size_t room;       /**< at most so many */
  int32_t complete;  /**< 1: the table may be used */
  /* state */
  truepose_table* table;
  truepose_table_block head; /**< of the current block */
  int32_t part;              /**< what the next bytes are */
  uint32_t seen;             /**< blocks so far, as bits */
  uint32_t length[2];        /**< of the blocks of the uncertain parameters */
  uint64_t mark;             /**< of the bytes so far */
} truepose_table_reader;

/** Expects a table from its first byte on. */
void truepose_table_begin(truepose_table_reader* reader, truepose_table* table);
/** `count` bytes are at `reader->at`, at most `reader->room`. @return as truepose_read_table() */
const char* truepose_table_got(truepose_table_reader* reader, size_t count);

/** Reads a table. May wait and allocate: call it only while a component is loaded.
 * @return null, or a short description of the error in the file */
const char* truepose_read_table(const char* path, truepose_table* table);

/** Writes a table. May wait and allocate. @return null, or a short reason of the failure */
const char* truepose_write_table(const char* path, truepose_table* table);

/** rad or m per machine unit of a reading, numbered as in q_e: angles are in degrees.
 * @param unit  m per machine unit of length */
truepose_real truepose_reading_scale(const truepose_description* robot, int reading,
                                     truepose_real unit);
/** rad or m per machine unit of a freedom of the pose. */
truepose_real truepose_freedom_scale(const truepose_description* robot, int freedom,
                                     truepose_real unit);
/** m per unit of a name: mm, inch or m; 0: another name. */
truepose_real truepose_unit(const char* name);

#endif
