/* libmodbus as a program that asks what it is told: one line in, one line out.
 *
 *   open PORT BAUD       tcp HOST PORT    timeout MS       close
 *   read UNIT FC AT COUNT                 -> values 1 0 1
 *   write UNIT FC AT VALUE...             -> done
 *   raw UNIT HEX                          -> done, on a serial port only
 *
 * and to all of them `silent`, `exception N` or `error WHY`. */

#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static modbus_t *line;

static void failed(void)
{
    if (errno == ETIMEDOUT)
        puts("silent");
    else if (errno > MODBUS_ENOBASE && errno <= MODBUS_ENOBASE + 11)
        printf("exception %d\n", errno - MODBUS_ENOBASE);
    else
        printf("error %s\n", modbus_strerror(errno));
}

static void do_read(int unit, int fc, int at, int count)
{
    uint8_t bits[MODBUS_MAX_READ_BITS];
    uint16_t words[MODBUS_MAX_READ_REGISTERS];
    int got = -1;

    modbus_set_slave(line, unit);
    switch (fc) {
    case 1: got = modbus_read_bits(line, at, count, bits); break;
    case 2: got = modbus_read_input_bits(line, at, count, bits); break;
    case 3: got = modbus_read_registers(line, at, count, words); break;
    case 4: got = modbus_read_input_registers(line, at, count, words); break;
    }
    if (got < 0) {
        failed();
        return;
    }
    printf("values");
    for (int i = 0; i < got; i++)
        printf(" %d", fc < 3 ? bits[i] : words[i]);
    puts("");
}

static void do_write(int unit, int fc, int at, char *rest)
{
    uint8_t bits[MODBUS_MAX_WRITE_BITS];
    uint16_t words[MODBUS_MAX_WRITE_REGISTERS];
    int count = 0, got = -1;

    for (char *word = strtok(rest, " "); word && count < 100; word = strtok(NULL, " ")) {
        bits[count] = words[count] = (uint16_t) atoi(word);
        count++;
    }
    modbus_set_slave(line, unit);
    switch (fc) {
    case 5: got = modbus_write_bit(line, at, bits[0]); break;
    case 6: got = modbus_write_register(line, at, words[0]); break;
    case 15: got = modbus_write_bits(line, at, count, bits); break;
    case 16: got = modbus_write_registers(line, at, count, words); break;
    }
    if (got < 0)
        failed();
    else
        puts("done");
}

static void do_raw(int unit, const char *hex)
{
    uint8_t request[MODBUS_MAX_ADU_LENGTH] = {(uint8_t) unit}, reply[MODBUS_MAX_ADU_LENGTH];
    int length = 1, got;

    for (unsigned byte; sscanf(hex, "%2x", &byte) == 1; hex += 2)
        request[length++] = (uint8_t) byte;
    modbus_set_slave(line, unit);
    modbus_flush(line);
    if (modbus_send_raw_request(line, request, length) < 0) {
        failed();
        return;
    }
    got = modbus_receive_confirmation(line, reply);
    if (got < 0)
        failed();
    else if (got < 5 || reply[0] != request[0] || (reply[1] & 0x7F) != request[1])
        puts("error another reply");
    else if (reply[1] & 0x80)
        printf("exception %d\n", reply[2]);
    else
        puts("done");
}

int main(void)
{
    char text[1024], path[512];
    int unit, fc, at, count, used = 0;

    setvbuf(stdout, NULL, _IOLBF, 0);
    while (fgets(text, sizeof text, stdin)) {
        text[strcspn(text, "\n")] = 0;
        if (sscanf(text, "open %511s %d", path, &count) == 2) {
            line = modbus_new_rtu(path, count, 'N', 8, 1);
            puts(modbus_connect(line) == 0 ? "done" : "error no port");
        } else if (sscanf(text, "tcp %511s %d", path, &count) == 2) {
            line = modbus_new_tcp(path, count);
            puts(modbus_connect(line) == 0 ? "done" : "error no connection");
        } else if (sscanf(text, "timeout %d", &count) == 1) {
            modbus_set_response_timeout(line, count / 1000, count % 1000 * 1000);
            puts("done");
        } else if (strcmp(text, "close") == 0) {
            modbus_close(line);
            modbus_free(line);
            puts("done");
        } else if (sscanf(text, "read %d %d %d %d", &unit, &fc, &at, &count) == 4) {
            do_read(unit, fc, at, count);
        } else if (sscanf(text, "write %d %d %d %n", &unit, &fc, &at, &used) == 3) {
            do_write(unit, fc, at, text + used);
        } else if (sscanf(text, "raw %d %n", &unit, &used) == 1) {
            do_raw(unit, text + used);
        } else {
            puts("error not understood");
        }
    }
    return 0;
}
