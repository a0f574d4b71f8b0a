/* As much of HAL as our modules need, so that two of them can be asked side by side in one process
 * without LinuxCNC: pins are memory, found by name, and functions run when they are told to. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct {
  char name[64];
  void* value;
} pins[8192];
static int count;

/** The latest pin of a name: modules that are loaded one after the other may use the same. */
void* stub_pin(const char* name) {
  for (int i = count - 1; i >= 0; --i)
    if (strcmp(pins[i].name, name) == 0) return pins[i].value;
  return NULL;
}

static int add(void** pin, const char* format, va_list arguments) {
  if (count == 8192) return -1;
  vsnprintf(pins[count].name, sizeof pins[count].name, format, arguments);
  pins[count].value = *pin = calloc(1, 8);
  ++count;
  return 0;
}
#define NEWF(kind)                                                                   \
  int hal_pin_##kind##_newf(int direction, void** pin, int id, const char* f, ...) { \
    va_list arguments;                                                               \
    (void)direction, (void)id;                                                       \
    va_start(arguments, f);                                                          \
    const int result = add(pin, f, arguments);                                       \
    va_end(arguments);                                                               \
    return result;                                                                   \
  }
NEWF(float)
NEWF(bit)
NEWF(s32)
NEWF(u32)
static int newf(void** pin, const char* f, ...) {
  va_list arguments;
  va_start(arguments, f);
  const int result = add(pin, f, arguments);
  va_end(arguments);
  return result;
}
int hal_pin_new(const char* name, int type, int direction, void** pin, int id) {
  (void)type, (void)direction, (void)id;
  return newf(pin, "%s", name);
}
int hal_pin_bit_new(const char* name, int direction, void** pin, int id) {
  return hal_pin_new(name, 0, direction, pin, id);
}
int hal_pin_s32_new(const char* name, int direction, void** pin, int id) {
  return hal_pin_new(name, 0, direction, pin, id);
}
static void (*function)(void*, long);
int hal_export_funct(const char* name, void (*f)(void*, long), void* arg, int fp, int reent,
                     int id) {
  (void)name, (void)arg, (void)fp, (void)reent, (void)id;
  function = f;
  return 0;
}
/** Runs the latest function so often. */
void stub_run(int cycles) {
  while (cycles-- > 0) function(NULL, 1000000);
}
/* One port, 1: bytes that a test has sent. */
static char sent[1 << 20];
static unsigned first, last;
void stub_send(const char* bytes, unsigned size) {
  memcpy(sent + last, bytes, size);
  last += size;
}
unsigned hal_port_readable(int port) { return port == 1 ? last - first : 0; }
_Bool hal_port_read(int port, char* to, unsigned size) {
  if (size > hal_port_readable(port)) return 0;
  memcpy(to, sent + first, size);
  first += size;
  if (first == last) first = last = 0;
  return 1;
}
int hal_init(const char* name) { return name != NULL; }
int hal_ready(int id) { return id != 1; }
int hal_exit(int id) { return id != 1; }
void* hal_malloc(long size) { return calloc(1, (size_t)size); }
int rtapi_vsnprintf(char* to, unsigned long size, const char* f, va_list arguments) {
  return vsnprintf(to, size, f, arguments);
}
int rtapi_snprintf(char* to, unsigned long size, const char* f, ...) {
  va_list arguments;
  va_start(arguments, f);
  const int result = vsnprintf(to, size, f, arguments);
  va_end(arguments);
  return result;
}
void rtapi_print_msg(int level, const char* f, ...) {
  va_list arguments;
  va_start(arguments, f);
  if (level <= 1) vfprintf(stderr, f, arguments);
  va_end(arguments);
}
void rtapi_print(const char* f, ...) { (void)f; }
