/* Reads the tables that `truepose export linuxcnc` writes. */
#include "table.h"

#include <stdio.h>
#include <string.h>

enum { COLUMN = 5, ROOT, FROM, END, PARTS, HEAD, START }; /* of the blocks below */

typedef struct part {
  char name[4];
  void* bytes;
  size_t size;
} part;

/** Blocks of a table with so many uncertain parameters, in their order. */
static void parts_of(truepose_table* table, size_t parameters, part parts[PARTS]) {
  const part all[PARTS] = {
      {"name", table->name, sizeof table->name},
      {"robt", &table->robot, sizeof table->robot},
      {"fine", &table->finest, sizeof table->finest},
      {"wtch", &table->monitor, sizeof table->monitor},
      {"sigm", table->known.sigma, sizeof table->known.sigma},
      {"colm", table->column, parameters * sizeof *table->column},
      {"root", table->root, parameters * parameters * sizeof *table->root},
      {"from", &table->from, sizeof table->from},
      {"mark", &table->mark, sizeof table->mark},
  };
  memcpy(parts, all, sizeof all);
}

/** FNV-1a of all bytes so far and these. */
static uint64_t marked(uint64_t mark, const void* bytes, size_t count) {
  const unsigned char* const at = bytes;
  for (size_t i = 0; i < count; ++i) mark = (mark ^ at[i]) * 1099511628211u;
  return mark;
}
static const uint64_t kUnmarked = 14695981039346656037u;

/** Continues with a block's head, or the start of the table. */
static void expect(truepose_table_reader* reader, int part) {
  reader->part = part;
  reader->at = (unsigned char*)&reader->head;
  reader->room = sizeof reader->head;
}

void truepose_table_begin(truepose_table_reader* reader, truepose_table* table) {
  memset(reader, 0, sizeof *reader);
  table->from = 0;
  reader->table = table;
  reader->mark = kUnmarked;
  expect(reader, START);
}

/** Continues with the bytes of the block whose head has arrived. */
static const char* enter(truepose_table_reader* reader) {
  part parts[PARTS];
  int k = 0;
  parts_of(reader->table, TRUEPOSE_TABLE_PARAMETERS, parts);
  while (k < PARTS && memcmp(reader->head.name, parts[k].name, 4) != 0) ++k;
  const int varies = k == COLUMN || k == ROOT;
  if (k == PARTS || reader->head.length > parts[k].size ||
      (!varies && reader->head.length != parts[k].size))
    return "was written for another version or another machine";
  if (varies) reader->length[k - COLUMN] = reader->head.length;
  reader->seen |= 1U << k;
  reader->part = k;
  reader->at = parts[k].bytes;
  reader->room = reader->head.length;
  return NULL;
}

static const char* complete(truepose_table_reader* reader) {
  const uint32_t all = (1U << FROM) - 1, fewest = 3; /* of a robot without sensors */
  truepose_table* const table = reader->table;
  const uint32_t seen = reader->seen & all, columns = reader->length[0] / sizeof(int32_t);
  if (table->mark != reader->mark) return "is damaged";
  if ((seen != fewest && seen != all) ||
      reader->length[1] != columns * columns * sizeof(truepose_real))
    return "is incomplete";
  if (table->from == 0) table->from = table->mark;
  table->monitored = seen == all;
  if (!table->monitored) table->finest = table->robot;
  table->known.count = (int32_t)columns;
  table->known.column = table->column;
  table->known.root = table->root;
  reader->complete = 1;
  return NULL;
}

const char* truepose_table_got(truepose_table_reader* reader, size_t count) {
  const char* wrong = NULL;
  if (reader->part != END) reader->mark = marked(reader->mark, reader->at, count);
  reader->at += count;
  reader->room -= count;
  while (reader->room == 0 && wrong == NULL && !reader->complete) {
    if (reader->part == START && memcmp(&reader->head, "truepose", 8) != 0)
      wrong = "is no table of truepose export linuxcnc";
    else if (reader->part == HEAD)
      wrong = enter(reader);
    else if (reader->part == END)
      wrong = complete(reader);
    else
      expect(reader, HEAD);
  }
  return wrong;
}

const char* truepose_read_table(const char* path, truepose_table* table) {
  FILE* file = path != NULL ? fopen(path, "rb") : NULL;
  const char* wrong = NULL;
  truepose_table_reader reader;
  if (file == NULL) return "cannot be opened";
  truepose_table_begin(&reader, table);
  while (wrong == NULL && !reader.complete) {
    const size_t count = reader.room;
    wrong = fread(reader.at, count, 1, file) == 1 ? truepose_table_got(&reader, count)
                                                  : "ends too early";
  }
  fclose(file);
  return wrong;
}

const char* truepose_write_table(const char* path, truepose_table* table) {
  part parts[PARTS];
  uint64_t mark = marked(kUnmarked, "truepose", 8);
  char begun[4096]; /* so that the table is either complete or absent */
  const int length = snprintf(begun, sizeof begun, "%s.new", path);
  FILE* file = length > 0 && (size_t)length < sizeof begun ? fopen(begun, "wb") : NULL;
  int good = file != NULL && fwrite("truepose", 8, 1, file) == 1;
  parts_of(table, (size_t)table->known.count, parts);
  for (int k = 0; good && k < PARTS; ++k) {
    truepose_table_block head = {{0}, (uint32_t)parts[k].size};
    memcpy(head.name, parts[k].name, 4);
    table->mark = mark = marked(mark, &head, sizeof head);
    mark = marked(mark, parts[k].bytes, parts[k].size);
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
