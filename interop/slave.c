/* A slave made with libmodbus: unit 3 on the port of the first argument, 9600 8N1, 100 coils and
   10 holding registers, of which 6 and 7 hold 871 and 123. It serves until its port is gone. */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    uint8_t query[MODBUS_RTU_MAX_ADU_LENGTH];
    modbus_t *slave = argc == 2 ? modbus_new_rtu(argv[1], 9600, 'N', 8, 1) : NULL;
    modbus_mapping_t *map = modbus_mapping_new(100, 0, 10, 0);

    if (!slave || !map || modbus_set_slave(slave, 3) || modbus_connect(slave))
        return EXIT_FAILURE;
    map->tab_registers[6] = 871;
    map->tab_registers[7] = 123;
    puts("ok");
    fflush(stdout);
    for (;;) {
        int length = modbus_receive(slave, query);
        if (length > 0)
            modbus_reply(slave, query, length, map);
        else if (length == -1 && errno == EIO)
            return EXIT_SUCCESS;
    }
}
