/* Says how far each answer is from the reference; fails beyond agree_within(). */
#include <stdio.h>

#include "agree.h"

int main(void) {
  truepose_real worst[AGREE_QUESTIONS];
  const int32_t asked = agree(worst);
  int far = asked <= 0;
  printf("%d robots\n", (int)asked);
  for (int k = 0; k < AGREE_QUESTIONS; ++k) {
    printf("%-9s %.1e\n", agree_names[k], (double)worst[k]);
    far |= !(worst[k] <= agree_within(k));
  }
  return far;
}
