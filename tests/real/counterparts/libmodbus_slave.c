/* A Modbus slave on libmodbus at unit 5, until it is ended. Usage: slave PORT BAUDRATE, or slave tcp NUMBER */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COUNT 64

int main(int argc, char **argv)
{
    int over_tcp = argc == 3 && strcmp(argv[1], "tcp") == 0, listening = -1;
    modbus_mapping_t *mapping = modbus_mapping_new(COUNT, COUNT, COUNT, COUNT);
    uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
    modbus_t *modbus;

    if (argc != 3 || mapping == NULL)
        return 1;
    modbus = over_tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2])) : modbus_new_rtu(argv[1], atoi(argv[2]), 'N', 8, 1);
    if (modbus == NULL || modbus_set_slave(modbus, 5))
        return 1;
    for (int at = 0; at < COUNT; at++) {
        mapping->tab_bits[at] = at % 3 == 0;
        mapping->tab_input_bits[at] = at % 2 == 0;
        mapping->tab_registers[at] = 500 + at;
        mapping->tab_input_registers[at] = 900 + at;
    }
    if (over_tcp)
        listening = modbus_tcp_listen(modbus, 1);
    else if (modbus_connect(modbus))
        return 1;
    puts("ready");
    fflush(stdout);
    for (;;) {
        if (over_tcp && modbus_tcp_accept(modbus, &listening) < 0)
            return 1;
        for (;;) {
            int length = modbus_receive(modbus, request);
            if (length > 0)
                modbus_reply(modbus, request, length, mapping);
            else if (length < 0 && over_tcp)
                break;
            else if (length < 0 && errno == EIO)
                return 0;
        }
        modbus_close(modbus);
    }
}
