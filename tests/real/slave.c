/* A Modbus slave on libmodbus: 16 holding registers at unit 5, until it is ended. Usage: slave PORT BAUDRATE */
#include <errno.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv)
{
    modbus_t *modbus = modbus_new_rtu(argv[1], atoi(argv[2]), 'N', 8, 1);
    modbus_mapping_t *mapping = modbus_mapping_new(0, 0, 16, 16);
    uint8_t request[MODBUS_RTU_MAX_ADU_LENGTH];

    if (argc != 3 || modbus == NULL || mapping == NULL || modbus_set_slave(modbus, 5) || modbus_connect(modbus))
        return 1;
    for (int at = 0; at < 16; at++)
        mapping->tab_registers[at] = 500 + at;
    puts("ready");
    fflush(stdout);
    for (;;) {
        int length = modbus_receive(modbus, request);
        if (length > 0)
            modbus_reply(modbus, request, length, mapping);
        else if (length < 0 && errno == EIO)
            return 0;
    }
}
