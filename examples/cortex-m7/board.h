/* Board functions for the measurement. */
#ifndef TRUEPOSE_BOARD_H
#define TRUEPOSE_BOARD_H

#include <stdint.h>

/** Prints a text. */
void say(const char* text);
/** Prints a number, right-aligned in a field of this width. */
void say_number(uint32_t number, int width);

/** Ticks of a 24-bit down-counter. */
uint32_t ticks(void);

/** Fills the free stack; used() then returns how many bytes of it were used. */
void paint(void);
uint32_t used(void);

#endif
