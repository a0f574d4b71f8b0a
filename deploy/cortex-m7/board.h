/* What a measurement needs of a board. */
#ifndef TRUEPOSE_BOARD_H
#define TRUEPOSE_BOARD_H

#include <stdint.h>

/** Says a text. */
void say(const char* text);
/** Says a number, right in a field so wide. */
void say_number(uint32_t number, int width);

/** Ticks of a clock that counts 24 bits down. */
uint32_t ticks(void);

/** Fills what is free of the stack; used() then says how many bytes of it were. */
void paint(void);
uint32_t used(void);

#endif
