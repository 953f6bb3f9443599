/* The libmodbus master: so many reads of coils, one after the other.
 * Arguments: terminal, address, first coil, number of coils, number of reads. */
#include <modbus.h>
#include <stdint.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    if (argc != 6)
        return 2;
    modbus_t *line = modbus_new_rtu(argv[1], 115200, 'N', 8, 1);
    if (!line || modbus_set_slave(line, atoi(argv[2])) || modbus_connect(line))
        return 1;
    modbus_set_response_timeout(line, 0, 200000);
    uint8_t coils[256];
    for (int reads = atoi(argv[5]); reads > 0; reads--)
        modbus_read_bits(line, atoi(argv[3]), atoi(argv[4]), coils);
    modbus_close(line);
    modbus_free(line);
    return 0;
}
