"""The node of ROS 1: run by the Python that has rospy, which needs nothing of ravenjax.

Bytes of messages come in on the standard input and go out by ROS; what ROS brings goes out on the
standard output. Each is preceded by its topic's number (uint16) and its length (uint32),
little-endian. Number 65535 is that of tables, in JSON. The first thing to come in names what there
is to do:

    {"name": ..., "published": [[topic, type, md5, definition, latched], ...], "subscribed": [...]}

Out go {"ready": true}, {"error": text}, {"connected": how many publish what is heard}, and, of a
topic whose md5 is empty, {"defined": [number, type, definition]} as its publisher has it.
"""

import json
import os
import struct
import threading
import time

HEAD = struct.Struct("<HI")
TABLE = 65535
QUEUE = 10
PERIOD_S = 0.05


def main():
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what ROS prints is no message
    source = os.fdopen(0, "rb")
    writing = threading.Lock()

    def tell(number, content):
        with writing:
            out.write(HEAD.pack(number, len(content)) + content)

    def tell_table(table):
        tell(TABLE, json.dumps(table).encode())

    def next_message():
        head = source.read(HEAD.size)
        if len(head) < HEAD.size:
            return None, b""
        number, length = HEAD.unpack(head)
        return number, source.read(length)

    _, content = next_message()
    table = json.loads(content)
    try:
        import rosgraph  # pyright: ignore[reportMissingImports]
        import rospy  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        tell_table({"error": f"rospy is not there ({error})"})
        return
    if not rosgraph.is_master_online():
        tell_table({"error": f"no ROS master answers at {rosgraph.get_master_uri()}"})
        return

    def message_class(kind, md5, definition):
        fields = {"_type": kind, "_md5sum": md5, "_full_text": definition, "_has_header": False}
        return type(kind.replace("/", "_"), (rospy.AnyMsg,), fields)

    def hearer(number, describes):
        unknown = [describes]

        def hear(message):
            if unknown[0]:
                unknown[0] = False
                header = message._connection_header
                tell_table({"defined": [number, header["type"], header["message_definition"]]})
            tell(number, message._buff)

        return hear

    rospy.init_node(table["name"], anonymous=True, disable_signals=True)
    publishers = [
        (
            rospy.Publisher(
                topic,
                message_class(kind, md5, text),
                queue_size=QUEUE,
                latch=latched,
                tcp_nodelay=True,
            )
        )
        for topic, kind, md5, text, latched in table["published"]
    ]
    subscribers = []
    for number, (topic, kind, md5, text, _) in enumerate(table["subscribed"]):
        data = message_class(kind, md5, text) if md5 else rospy.AnyMsg
        hear = hearer(number, not md5)
        subscribers.append(rospy.Subscriber(topic, data, hear, queue_size=QUEUE, tcp_nodelay=True))
    tell_table({"ready": True})

    def watch():
        last = None
        while not rospy.is_shutdown():
            connected = sum(one.get_num_connections() for one in subscribers)
            if connected != last:
                last = connected
                tell_table({"connected": connected})
            time.sleep(PERIOD_S)
        os._exit(1)  # another node has taken the name, or the master sent this one away

    threading.Thread(target=watch, daemon=True).start()
    while True:
        number, content = next_message()
        if number is None:
            break
        message = publishers[number].data_class()
        message._buff = content
        publishers[number].publish(message)
    rospy.signal_shutdown("the robot is gone")


if __name__ == "__main__":
    main()
