/* The Modbus TCP server of libmodbus, on one thread: coils that are off, as its own example for
 * many connections serves them. Serves until the process is ended; its address is the first line
 * of its output. */
#include <arpa/inet.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

static int listen_anywhere(void)
{
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof at;
    int listener = socket(AF_INET, SOCK_STREAM, 0);
    if (listener < 0 || bind(listener, (struct sockaddr *)&at, length) || listen(listener, 64)
        || getsockname(listener, (struct sockaddr *)&at, &length))
        return -1;
    printf("127.0.0.1:%d\n", ntohs(at.sin_port));
    fflush(stdout);
    return listener;
}

int main(void)
{
    int listener = listen_anywhere();
    modbus_t *server = modbus_new_tcp(NULL, 0);
    modbus_mapping_t *map = modbus_mapping_new(256, 0, 0, 0);
    if (listener < 0 || !server || !map)
        return 1;
    fd_set open;
    FD_ZERO(&open);
    FD_SET(listener, &open);
    int last = listener;
    for (;;) {
        fd_set ready = open;
        if (select(last + 1, &ready, NULL, NULL, NULL) < 0)
            return 1;
        for (int fd = 0; fd <= last; fd++) {
            if (!FD_ISSET(fd, &ready))
                continue;
            if (fd == listener) {
                int stream = accept(listener, NULL, NULL), on = 1;
                if (stream < 0 || stream >= FD_SETSIZE)
                    return 1;
                setsockopt(stream, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
                FD_SET(stream, &open);
                last = stream > last ? stream : last;
                continue;
            }
            uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
            modbus_set_socket(server, fd);
            int length = modbus_receive(server, request);
            if (length > 0) {
                modbus_reply(server, request, length, map);
            } else if (length < 0) {
                close(fd);
                FD_CLR(fd, &open);
            }
        }
    }
}
