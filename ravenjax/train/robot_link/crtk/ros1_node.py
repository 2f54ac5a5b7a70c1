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

    def message_class(_, kind, md5, definition, __):
        if not md5:
            return rospy.AnyMsg
        fields = {"_type": kind, "_md5sum": md5, "_full_text": definition, "_has_header": False}
        return type(kind.replace("/", "_"), (rospy.AnyMsg,), fields)

    undefined = {number for number, (_, _, md5, *_) in enumerate(subscribed) if not md5}

    def hear(message, number):
        if number in undefined:
            undefined.discard(number)
            tell("defined", (number, message._connection_header["message_definition"]))
        tell(number, message._buff)

    rospy.init_node("ravenjax", anonymous=True, disable_signals=True)
    options = {"queue_size": QUEUE, "tcp_nodelay": True}
    publishers = [
        rospy.Publisher(topic[0], message_class(*topic), latch=topic[-1], **options)
        for topic in published
    ]
    subscribers = [
        rospy.Subscriber(topic[0], message_class(*topic), hear, number, **options)
        for number, topic in enumerate(subscribed)
    ]
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
