"""Runs the ROS 1 node, in the Python that has rospy. It imports nothing of ravenjax.

Its argument is the descriptor of a socket that `multiprocessing.connection` reads and writes. The
first message is a pair of lists [[topic, type, md5, definition, latched], ...]: the topics to
publish and the topics to subscribe to. After that, pairs go both ways: the number of a topic in its
list, and the bytes of a message. The node also sends ("ready", None), ("error", text),
("connected", number of publishers of subscribed topics), and ("defined", (number, definition)) for
a topic whose md5 is empty, with its publisher's definition.
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

    def tell(word, content=None):
        with writing:
            link.send((word, content))

    published, subscribed = link.recv()
    try:
        import rosgraph  # pyright: ignore[reportMissingImports]
        import rospy  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        tell("error", f"rospy cannot be imported ({error})")
        return
    if not rosgraph.is_master_online():
        tell("error", f"no ROS master answers at {rosgraph.get_master_uri()}")
        return

    def message_class(kind, md5, definition):
        fields = {"_type": kind, "_md5sum": md5, "_full_text": definition, "_has_header": False}
        return type(kind.replace("/", "_"), (rospy.AnyMsg,), fields)

    def hearer(number, is_defined):
        defined = [is_defined]

        def hear(message):
            if not defined[0]:
                defined[0] = True
                tell("defined", (number, message._connection_header["message_definition"]))
            tell(number, message._buff)

        return hear

    rospy.init_node("ravenjax", anonymous=True, disable_signals=True)
    publishers = []
    for topic, kind, md5, text, latched in published:
        data = message_class(kind, md5, text)
        publishers.append(
            rospy.Publisher(topic, data, queue_size=QUEUE, latch=latched, tcp_nodelay=True)
        )
    subscribers = []
    for number, (topic, kind, md5, text, _) in enumerate(subscribed):
        data = message_class(kind, md5, text) if md5 else rospy.AnyMsg
        hear = hearer(number, bool(md5))
        subscribers.append(rospy.Subscriber(topic, data, hear, queue_size=QUEUE, tcp_nodelay=True))
    tell("ready")

    def watch():
        last = None
        while not rospy.is_shutdown():
            connected = sum(subscriber.get_num_connections() for subscriber in subscribers)
            if connected != last:
                last = connected
                tell("connected", connected)
            time.sleep(PERIOD_S)
        # Another node took the name, or the master shut this one down.
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
    rospy.signal_shutdown("the robot is gone")


if __name__ == "__main__":
    main()
