/* A table behind Modbus that shares nothing with this project but its register map: libmodbus and forty lines of state.
 *
 * modbus_server tcp          listens on 127.0.0.1, prints its port
 * modbus_server rtu DEVICE   serves unit 1 on a serial line at 115200 8N1, prints 0
 *
 * Registers as data/tables/bench.toml has them. The table enables by 0x06, 0x07, 0x0F, homes at once, and stands where
 * a move sends it at once; a second command register, 23, is counted and shown in 24, to tell repeated writes apart.
 * Writing 0xDEAD to register 23 makes every later request fail with exception 6 (busy) until the server ends.
 */
#include <arpa/inet.h>
#include <modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { MODEL = 0, SERIAL = 8, CONTROL = 16, STATUS, FAULT, INTERLOCK, WATCHDOG, HEARTBEAT, COMMAND, PROBE, COUNT };
enum { OUTER = 30, INNER = 50, POSITION = 0, RATE = 2, TARGET = 4, LOW = 10, HIGH = 12, SIZE = 64 };
enum { REMOTE = 1 << 9, SETTLED = 1 << 10, HOMED = 1 << 12, QUICK_STOP = 1 << 5 };

static uint16_t *words;

static void put_text(int at, const char *text) {
    char padded[16] = {0};
    strncpy(padded, text, sizeof padded);
    for (int i = 0; i < 8; i++)
        words[at + i] = (uint16_t)((unsigned char)padded[2 * i] << 8 | (unsigned char)padded[2 * i + 1]);
}

static void put_long(int at, int32_t value) {
    words[at] = (uint16_t)((uint32_t)value >> 16);
    words[at + 1] = (uint16_t)value;
}

static void obey(void) {
    static int power;
    switch (words[CONTROL] & 0x0F) {
    case 0x06: power = 0x21; break;
    case 0x07: power = power ? 0x23 : 0x40; break;
    case 0x0F: power = power == 0x23 ? 0x27 : power; break;
    default: power = 0x40;
    }
    if (words[COMMAND] == 3)
        words[STATUS] |= HOMED;
    if (words[COMMAND] == 1 && power == 0x27 && words[STATUS] & HOMED)
        for (int joint = OUTER; joint <= INNER; joint += INNER - OUTER)
            memcpy(words + joint + POSITION, words + joint + TARGET, 4);
    words[COMMAND] = 0;
    words[STATUS] = (uint16_t)((words[STATUS] & HOMED) | REMOTE | SETTLED | QUICK_STOP | power);
}

int main(int argc, char **argv) {
    int over_tcp = argc == 2 && !strcmp(argv[1], "tcp"), listening = -1;
    if (!over_tcp && !(argc == 3 && !strcmp(argv[1], "rtu")))
        return 2;
    modbus_t *link = over_tcp ? modbus_new_tcp("127.0.0.1", 0) : modbus_new_rtu(argv[2], 115200, 'N', 8, 1);
    modbus_mapping_t *map = modbus_mapping_new(0, 0, SIZE, 0);
    if (link == NULL || map == NULL)
        return 1;
    words = map->tab_registers;
    put_text(MODEL, "bench-table");
    put_text(SERIAL, "LIBMODBUS-1");
    words[INTERLOCK] = 1;
    words[WATCHDOG] = 2000;
    for (int joint = OUTER; joint <= INNER; joint += INNER - OUTER) {
        put_long(joint + LOW, -108000000);
        put_long(joint + HIGH, 108000000);
    }
    obey();
    modbus_set_slave(link, 1);
    if (over_tcp) {
        struct sockaddr_in address;
        socklen_t size = sizeof address;
        listening = modbus_tcp_listen(link, 1);
        if (listening < 0 || getsockname(listening, (struct sockaddr *)&address, &size) < 0)
            return 1;
        printf("%d\n", ntohs(address.sin_port));
    } else {
        if (modbus_connect(link) < 0)
            return 1;
        printf("0\n");
    }
    fflush(stdout);
    for (int busy = 0;;) {
        uint8_t query[MODBUS_MAX_ADU_LENGTH];
        if (over_tcp && modbus_get_socket(link) < 0 && modbus_tcp_accept(link, &listening) < 0)
            return 1;
        int length = modbus_receive(link, query);
        if (length < 0 && over_tcp) {
            modbus_close(link);
            modbus_set_socket(link, -1);
            continue;
        }
        if (length <= 0)
            continue;
        if (busy)
            modbus_reply_exception(link, query, MODBUS_EXCEPTION_SLAVE_OR_SERVER_BUSY);
        else
            modbus_reply(link, query, length, map);
        if (words[PROBE]) {
            busy = words[PROBE] == 0xDEAD;
            words[COUNT]++;
            words[PROBE] = 0;
        }
        obey();
    }
}
