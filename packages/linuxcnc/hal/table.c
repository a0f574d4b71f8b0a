/* Reads the tables that `truepose export linuxcnc` writes. */
#include "table.h"

#include <stdio.h>
#include <string.h>

typedef struct block {
  char name[4];
  uint32_t length;
} block;

/** Destination of a block's bytes. @return null: no such block */
static void* place(const char* name, truepose_table* table, size_t* most) {
  const struct {
    const char* name;
    void* to;
    size_t size;
  } places[] = {
      {"robt", &table->robot, sizeof table->robot},
      {"fine", &table->finest, sizeof table->finest},
      {"wtch", &table->monitor, sizeof table->monitor},
      {"sigm", table->known.sigma, sizeof table->known.sigma},
      {"colm", table->column, sizeof table->column},
      {"root", table->root, sizeof table->root},
      {"from", &table->from, sizeof table->from},
  };
  for (size_t i = 0; i < sizeof places / sizeof *places; ++i)
    if (memcmp(name, places[i].name, 4) == 0) {
      *most = places[i].size;
      return places[i].to;
    }
  return NULL;
}

/** FNV-1a of all bytes so far and these. */
static uint64_t marked(uint64_t mark, const void* bytes, size_t count) {
  const unsigned char* const at = bytes;
  for (size_t i = 0; i < count; ++i) mark = (mark ^ at[i]) * 1099511628211u;
  return mark;
}

static int named(const block* head, const char* name) { return memcmp(head->name, name, 4) == 0; }

static const char* read_blocks(FILE* file, truepose_table* table) {
  char start[8];
  block head;
  uint32_t columns = 0, root = 0, fixed = 0;
  uint64_t mark = 14695981039346656037u;
  if (fread(start, sizeof start, 1, file) != 1 || memcmp(start, "truepose", 8) != 0)
    return "is no table of truepose export linuxcnc";
  while (fread(&head, sizeof head, 1, file) == 1) {
    size_t most = 0;
    void* to = place(head.name, table, &most);
    const int varies = named(&head, "colm") || named(&head, "root");
    if (to == NULL || head.length > most || (!varies && head.length != most))
      return "was written for another version or another machine";
    if (head.length != 0 && fread(to, head.length, 1, file) != 1) return "ends too early";
    if (named(&head, "colm")) columns = head.length / sizeof(int32_t);
    if (named(&head, "root")) root = head.length / sizeof(truepose_real);
    fixed += !varies && !named(&head, "from");
    mark = marked(mark, to, head.length);
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

const char* truepose_write_table(const char* path, const truepose_description* robot,
                                 const truepose_description* finest,
                                 const truepose_knowledge* known, const truepose_table* began) {
  const size_t p = (size_t)known->count;
  const struct {
    const char* name;
    const void* bytes;
    size_t size;
  } blocks[] = {
      {"robt", robot, sizeof *robot},
      {"fine", finest, sizeof *finest},
      {"wtch", &began->monitor, sizeof began->monitor},
      {"sigm", known->sigma, sizeof known->sigma},
      {"colm", known->column, p * sizeof *known->column},
      {"root", known->root, p * p * sizeof *known->root},
      {"from", &began->from, sizeof began->from},
  };
  char begun[4096]; /* so that the table is either complete or absent */
  const int length = snprintf(begun, sizeof begun, "%s.new", path);
  FILE* file = length > 0 && (size_t)length < sizeof begun ? fopen(begun, "wb") : NULL;
  int good = file != NULL && fwrite("truepose", 8, 1, file) == 1;
  for (size_t i = 0; good && i < sizeof blocks / sizeof *blocks; ++i) {
    block head = {{0}, (uint32_t)blocks[i].size};
    memcpy(head.name, blocks[i].name, 4);
    good = fwrite(&head, sizeof head, 1, file) == 1 &&
           fwrite(blocks[i].bytes, 1, blocks[i].size, file) == blocks[i].size;
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
