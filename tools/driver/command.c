/* What the wheels do with a command, after `sidestep interface --c > sidestep.h`:

     cc -std=c11 -I. command.c -o command && ./command < commands.bin

   reads commands as they lie in shared memory and prints for each what a base must do when it arrives, and what it
   must do by itself once valid_until_ns has passed. With the C API of iceoryx2 the bytes come from a subscriber. */
#define _POSIX_C_SOURCE 199309L
#include "sidestep.h"
#include <stdio.h>

int main(void)
{
    Command command;
    while (fread(&command, sizeof command, 1, stdin) == 1) {
        Twist now = sidestep_obey(&command, command.valid_until_ns - 1);
        Twist late = sidestep_obey(&command, command.valid_until_ns);
        printf("%.3f m/s %.3f rad/s, then %.3f m/s %.3f rad/s: %s, %s\n", now.v_m_s, now.w_rad_s, late.v_m_s,
               late.w_rad_s, sidestep_winner_label(command.winner), sidestep_reason_label(command.reason));
    }
    return 0;
}
