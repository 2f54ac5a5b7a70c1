"""Runs a ROS 1 node in the Python that has rospy. It imports nothing of ravenjax.

The node and ravenjax exchange pairs over a socket, by `multiprocessing.connection`. The argument of
the program is the socket's file descriptor. The first pair comes from ravenjax: a list of topics to
publish, and a list of topics to subscribe to. A topic is [name, type, md5, definition, latched].
Both sides then send (index of a topic in its list, bytes of a ROS message). The node also sends:

- ("ready", None) when it has started, or ("error", text) if it cannot start
- ("connected", number of publishers of the subscribed topics) when this number changes
- ("defined", (index of a topic, message definition of its publisher)) before the first message of a
  topic with an empty md5, which accepts messages of any definition
"""

import os
import sys
import threading
import time
from multiprocessing.connection import Connection

QUEUE = 10
PERIOD_S = 0.05


def main():
    link = Connection(int(sys.argv[1]))
    writing = threading.Lock()

    def send(word, content=None):
        with writing:
            link.send((word, content))

    published, subscribed = link.recv()
    try:
        import rosgraph  # pyright: ignore[reportMissingImports]
        import rospy  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        send("error", f"rospy cannot be imported ({error})")
        return
    if not rosgraph.is_master_online():
        send("error", f"no ROS master answers at {rosgraph.get_master_uri()}")
        return

    def message_class(_, kind, md5, definition, __):
        if not md5:
            return rospy.AnyMsg
        fields = {"_type": kind, "_md5sum": md5, "_full_text": definition, "_has_header": False}
        return type(kind.replace("/", "_"), (rospy.AnyMsg,), fields)

    undefined = {number for number, (_, _, md5, *_) in enumerate(subscribed) if not md5}

    def forward(message, number):
        if number in undefined:
            undefined.discard(number)
            send("defined", (number, message._connection_header["message_definition"]))
        send(number, message._buff)

    rospy.init_node("ravenjax", anonymous=True, disable_signals=True)
    options = {"queue_size": QUEUE, "tcp_nodelay": True}
    publishers = [
        rospy.Publisher(topic[0], message_class(*topic), latch=topic[-1], **options)
        for topic in published
    ]
    subscribers = [
        rospy.Subscriber(topic[0], message_class(*topic), forward, number, **options)
        for number, topic in enumerate(subscribed)
    ]
    send("ready")

    def watch():
        last = None
        while not rospy.is_shutdown():
            connected = sum(subscriber.get_num_connections() for subscriber in subscribers)
            if connected != last:
                last = connected
                send("connected", connected)
            time.sleep(PERIOD_S)
        # rospy shuts down if another node takes the name, or if the master requests it.
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    while True:
        try:
            number, content = link.recv()
        except (EOFError, OSError):
            break
        message = publishers[number].data_class()
        message._buff = content
        publishers[number].publish(message)
    rospy.signal_shutdown("the robot's process has ended")


if __name__ == "__main__":
    main()
