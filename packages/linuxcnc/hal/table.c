/* Reads the tables that `truepose export linuxcnc` writes. */
#include "table.h"

#include <stdio.h>
#include <string.h>

typedef struct block {
  char name[4];
  uint32_t length;
} block;

enum { COLUMN = 4, ROOT, FROM, PARTS }; /* of the blocks below */

typedef struct part {
  char name[4];
  void* bytes;
  size_t size;
} part;

/** Blocks of a table with so many uncertain parameters, in their order. */
static void parts_of(truepose_table* table, size_t parameters, part parts[PARTS]) {
  const part all[PARTS] = {
      {"robt", &table->robot, sizeof table->robot},
      {"fine", &table->finest, sizeof table->finest},
      {"wtch", &table->monitor, sizeof table->monitor},
      {"sigm", table->known.sigma, sizeof table->known.sigma},
      {"colm", table->column, parameters * sizeof *table->column},
      {"root", table->root, parameters * parameters * sizeof *table->root},
      {"from", &table->from, sizeof table->from},
  };
  memcpy(parts, all, sizeof all);
}

/** FNV-1a of all bytes so far and these. */
static uint64_t marked(uint64_t mark, const void* bytes, size_t count) {
  const unsigned char* const at = bytes;
  for (size_t i = 0; i < count; ++i) mark = (mark ^ at[i]) * 1099511628211u;
  return mark;
}

static const char* read_blocks(FILE* file, truepose_table* table) {
  char start[8];
  block head;
  part parts[PARTS];
  uint32_t columns = 0, root = 0, fixed = 0;
  uint64_t mark = 14695981039346656037u;
  parts_of(table, TRUEPOSE_TABLE_PARAMETERS, parts);
  if (fread(start, sizeof start, 1, file) != 1 || memcmp(start, "truepose", 8) != 0)
    return "is no table of truepose export linuxcnc";
  while (fread(&head, sizeof head, 1, file) == 1) {
    int k = 0;
    while (k < PARTS && memcmp(head.name, parts[k].name, 4) != 0) ++k;
    const int varies = k == COLUMN || k == ROOT;
    if (k == PARTS || head.length > parts[k].size || (!varies && head.length != parts[k].size))
      return "was written for another version or another machine";
    if (head.length != 0 && fread(parts[k].bytes, head.length, 1, file) != 1)
      return "ends too early";
    if (k == COLUMN) columns = head.length / sizeof(int32_t);
    if (k == ROOT) root = head.length / sizeof(truepose_real);
    fixed += k < COLUMN;
    mark = marked(mark, parts[k].bytes, head.length);
  }
  if (table->from == 0) table->from = mark;
  if ((fixed != 1 && fixed != 4) || root != columns * columns) return "ends too early";
  table->monitored = fixed == 4;
  if (!table->monitored) table->finest = table->robot;
  table->known.count = (int32_t)columns;
  table->known.column = table->column;
  table->known.root = table->root;
  return NULL;
}

const char* truepose_read_table(const char* path, truepose_table* table) {
  FILE* file = path != NULL ? fopen(path, "rb") : NULL;
  const char* wrong = "cannot be opened";
  memset(table, 0, sizeof *table);
  if (file == NULL) return wrong;
  wrong = read_blocks(file, table);
  fclose(file);
  return wrong;
}

const char* truepose_write_table(const char* path, truepose_table* table) {
  part parts[PARTS];
  char begun[4096]; /* so that the table is either complete or absent */
  const int length = snprintf(begun, sizeof begun, "%s.new", path);
  FILE* file = length > 0 && (size_t)length < sizeof begun ? fopen(begun, "wb") : NULL;
  int good = file != NULL && fwrite("truepose", 8, 1, file) == 1;
  parts_of(table, (size_t)table->known.count, parts);
  for (int k = 0; good && k < PARTS; ++k) {
    block head = {{0}, (uint32_t)parts[k].size};
    memcpy(head.name, parts[k].name, 4);
    good = fwrite(&head, sizeof head, 1, file) == 1 &&
           fwrite(parts[k].bytes, 1, parts[k].size, file) == parts[k].size;
  }
  if (file != NULL) good = fclose(file) == 0 && good;
  return good && rename(begun, path) == 0 ? NULL : "cannot be written";
}

static const truepose_real kDegree = 0.017453292519943295;

truepose_real truepose_freedom_scale(const truepose_description* robot, int freedom,
                                     truepose_real unit) {
  return freedom < (robot->mobility >= TRUEPOSE_TRANSLATION ? 3 : 2) ? unit : kDegree;
}

truepose_real truepose_reading_scale(const truepose_description* robot, int reading,
                                     truepose_real unit) {
  int motor = reading;
  if (reading >= robot->motors) {
    const truepose_sensor* sensor = &robot->sensor[reading - robot->motors];
    switch (sensor->kind) {
      case TRUEPOSE_PLANE_DISTANCE:
      case TRUEPOSE_COORDINATE:
      case TRUEPOSE_DISTANCE:
      case TRUEPOSE_ROD_LENGTH: return unit;
      case TRUEPOSE_MOTOR_ENCODER: motor = sensor->chain; break;
      default: return kDegree;
    }
  }
  return robot->chain[motor].actuator == TRUEPOSE_REVOLUTE ? kDegree : unit;
}

truepose_real truepose_unit(const char* name) {
  static const struct {
    const char* name;
    truepose_real metres;
  } units[] = {{"mm", 0.001}, {"inch", 0.0254}, {"m", 1}};
  for (size_t i = 0; i < sizeof units / sizeof *units; ++i)
    if (strcmp(name, units[i].name) == 0) return units[i].metres;
  return 0;
}
