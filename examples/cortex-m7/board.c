/* Board support for a Cortex-M7: from reset to main(), clock, stack, console by semihosting. */
#include "board.h"

#include <string.h>

enum { PAINTED = 64 * 1024, COLOUR = 0xA5 };

extern char data_start[], data_end[], data_load[], bss_start[], bss_end[], stack_top[];
int main(void);

static volatile uint32_t* const CPACR = (volatile uint32_t*)0xE000ED88;    /* coprocessors */
static volatile uint32_t* const SYST_CSR = (volatile uint32_t*)0xE000E010; /* control */
static volatile uint32_t* const SYST_RVR = (volatile uint32_t*)0xE000E014; /* reload */
static volatile uint32_t* const SYST_CVR = (volatile uint32_t*)0xE000E018; /* current value */

static void semihost(uint32_t operation, const void* argument) {
  register uint32_t r0 __asm__("r0") = operation;
  register const void* r1 __asm__("r1") = argument;
  __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void leave(uint32_t code) {
  const uint32_t block[2] = {0x20026, code}; /* the application ended */
  semihost(0x20, block);
  for (;;) continue;
}

static void fault(void) {
  say("fault\n");
  leave(2);
}

__attribute__((noreturn)) void reset(void) {
  *CPACR |= 0xFu << 20; /* double-precision unit, before any use of its registers */
  __asm__ volatile("dsb\n isb");
  memcpy(data_start, data_load, (size_t)(data_end - data_start));
  memset(bss_start, 0, (size_t)(bss_end - bss_start));
  *SYST_RVR = 0xFFFFFF;
  *SYST_CVR = 0;
  *SYST_CSR = 5; /* enabled, processor clock, no interrupt */
  leave((uint32_t)main());
  for (;;) continue;
}

__attribute__((section(".vectors"), used)) static const void* const vectors[16] = {
    stack_top, (void*)reset, (void*)fault, (void*)fault, (void*)fault, (void*)fault, (void*)fault};

void say(const char* text) { semihost(4, text); }

void say_number(uint32_t number, int width) {
  char text[12], *end = text + sizeof text - 1, *at = end;
  *at = 0;
  do *--at = (char)('0' + number % 10);
  while ((number /= 10) != 0);
  while (end - at < width) *--at = ' ';
  say(at);
}

uint32_t ticks(void) { return *SYST_CVR; }

static volatile char* here(void) {
  volatile char* at;
  __asm__ volatile("mov %0, sp" : "=r"(at));
  return at;
}

void paint(void) {
  volatile char* const top = here();
  for (volatile char* at = top - PAINTED; at < top; ++at) *at = COLOUR;
}

uint32_t used(void) {
  const volatile char *const top = here(), *at = top - PAINTED + 1024;
  while (*at == COLOUR) ++at;
  return (uint32_t)(top - at);
}
