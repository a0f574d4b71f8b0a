/* Reads the tables that `truepose export linuxcnc` writes. */
#include "table.h"

#include <stdio.h>
#include <string.h>

typedef struct block {
  char name[4];
  uint32_t length;
} block;

/** Where a block's bytes belong. @return null: no such block */
static void* place(const char* name, truepose_table* table, size_t* most) {
  const struct {
    const char* name;
    void* to;
    size_t size;
  } places[] = {
      {"robt", &table->robot, sizeof table->robot},
      {"fine", &table->finest, sizeof table->finest},
      {"wtch", &table->watch, sizeof table->watch},
      {"sigm", table->known.sigma, sizeof table->known.sigma},
      {"colm", table->column, sizeof table->column},
      {"root", table->root, sizeof table->root},
  };
  for (size_t i = 0; i < sizeof places / sizeof *places; ++i)
    if (memcmp(name, places[i].name, 4) == 0) {
      *most = places[i].size;
      return places[i].to;
    }
  return NULL;
}

static const char* read_blocks(FILE* file, truepose_table* table) {
  char start[8];
  block head;
  uint32_t columns = 0, root = 0, fixed = 0;
  if (fread(start, sizeof start, 1, file) != 1 || memcmp(start, "truepose", 8) != 0)
    return "is no table of truepose export linuxcnc";
  while (fread(&head, sizeof head, 1, file) == 1) {
    size_t most = 0;
    void* to = place(head.name, table, &most);
    const int varies = memcmp(head.name, "colm", 4) == 0 || memcmp(head.name, "root", 4) == 0;
    if (to == NULL || head.length > most || (!varies && head.length != most))
      return "was written for another version or another machine";
    if (head.length != 0 && fread(to, head.length, 1, file) != 1) return "ends too early";
    if (memcmp(head.name, "colm", 4) == 0) columns = head.length / sizeof(int32_t);
    if (memcmp(head.name, "root", 4) == 0) root = head.length / sizeof(truepose_real);
    fixed += !varies;
  }
  if ((fixed != 1 && fixed != 4) || root != columns * columns) return "ends too early";
  table->watched = fixed == 4;
  if (!table->watched) table->finest = table->robot;
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

truepose_real truepose_reading_scale(const truepose_description* robot, int reading,
                                     truepose_real unit) {
  static const truepose_real degree = 0.017453292519943295;
  int motor = reading;
  if (reading >= robot->motors) {
    const truepose_sensor* sensor = &robot->sensor[reading - robot->motors];
    switch (sensor->kind) {
      case TRUEPOSE_TELEMETER:
      case TRUEPOSE_COORDINATE:
      case TRUEPOSE_DISTANCE:
      case TRUEPOSE_ROD_LENGTH: return unit;
      case TRUEPOSE_MOTOR_ENCODER: motor = sensor->chain; break;
      default: return degree;
    }
  }
  return robot->chain[motor].actuator == TRUEPOSE_REVOLUTE ? degree : unit;
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
