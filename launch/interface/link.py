# From here on: the run that started this program. Needs the package iceoryx2 in the version below.

TICK_NS = 10_000_000  # [ns] between two odometry messages, and two commands
BEAT_NS = 25_000_000  # [ns] between two heartbeats; a program that beats and falls silent is killed
PATIENCE_NS = 2_000_000_000  # [ns] host time that an answer may take in lockstep


def host_ns():
    """[ns] host time, CLOCK_MONOTONIC: graph time too, unless a player or a lockstep driver moves it."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class Refused(SystemExit):
    """Ends the program with a line, unless caught: exit code 2 for configuration, 3 for input and output."""

    def __init__(self, code, text):
        print(text, file=sys.stderr, flush=True)
        super().__init__(code)


def _told(name):
    if name not in os.environ:
        raise Refused(2, f"environment variable {name} is not set; drivers are started by `sidestep run`")
    return os.environ[name]


def _graph(path):
    try:
        import tomllib
    except ImportError:  # before Python 3.11
        try:
            import tomli as tomllib
        except ImportError:
            raise Refused(2, "Python is older than 3.11 and has no package tomli; pip install tomli") from None
    with open(path, "rb") as file:
        return tomllib.load(file)


class Link:
    """The run that started this program: `Link()`, then a Writer or a Reader per topic.

    With `heartbeat`, the loops below say 40 times a second that the program lives, and the launcher kills it when they
    fall silent; without, it counts as ready at its first message, and only its end is noticed.
    """

    def __init__(self, heartbeat=True):
        try:
            import iceoryx2
            from importlib.metadata import version
        except ImportError:
            raise Refused(2, f"Python package iceoryx2 is missing; pip install iceoryx2=={ICEORYX2}") from None
        if version("iceoryx2") != ICEORYX2:
            found = version("iceoryx2")
            raise Refused(2, f"Python package iceoryx2 is {found}, needed {ICEORYX2}: memory is laid out per version")
        self.iox = iceoryx2
        self.name, self.run = _told("SIDESTEP_NODE"), int(_told("SIDESTEP_RUN"))
        self.incarnation = int(_told("SIDESTEP_INCARNATION"))
        graph = _graph(_told("SIDESTEP_GRAPH"))
        self.lockstep = graph["time"] == "lockstep"
        self.nodes = [*graph["nodes"], *graph.get("external", {})]
        self.stopping, self.published = False, False
        self.rate_most = 2.0  # graph seconds per host second in lockstep: a recorder must keep up
        self.counts = {kind: [0] * TOPICS_MAX for kind in ("sent", "lost", "skipped")}
        self._taken, self._rare, self._beat_due_ns, self._health = {}, [], 0, None
        self._clock, self._begun = None, None
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: setattr(self, "stopping", True))
        self._join(_told("SIDESTEP_DOMAIN"), _told("SIDESTEP_ROOT"))
        if heartbeat and "health/" + self.name in TOPICS:
            self._health = Writer(self, "health/" + self.name)
            atexit.register(lambda: self._beat(NodeState.STOPPING))
            self._beat(NodeState.READY)

    def _join(self, prefix, root):
        iox = self.iox
        iox.set_log_level(iox.LogLevel.Fatal)
        self._config = iox.config.default()
        shared = self._config.global_cfg
        shared.prefix, shared.root_path = iox.FileName.new(prefix), iox.Path.new(root)
        # Only the launcher cleans up after the dead: a cleaner in here would stall the loop.
        shared.node.cleanup_dead_nodes_on_creation = False
        shared.node.cleanup_dead_nodes_on_destruction = False
        shared.service.cleanup_dead_nodes_on_open = False
        builder = iox.NodeBuilder.new().name(iox.NodeName.new(self.name)).config(self._config)
        self._node = builder.signal_handling_mode(iox.SignalHandlingMode.Disabled).create(iox.ServiceType.Ipc)

    def _service(self, topic):
        return self._node.service_builder(self.iox.ServiceName.new("sidestep/" + topic))

    def _open(self, topic):
        """The launcher has created every service; its attribute `layout` must be the one of this module."""
        iox, row = self.iox, TOPICS[topic]
        key, value = iox.AttributeKey.new("layout"), iox.AttributeValue.new(row.layout)
        builder = self._service(topic).publish_subscribe(row.structure).user_header(Header)
        try:
            return builder.open_with_attributes(iox.AttributeVerifier.new().require(key, value))
        except iox.PublishSubscribeOpenError as error:
            text = f"topic {topic}: layout here is {row.layout}, {self._layout_found(topic, key) or error}"
            raise Refused(2, f"{text}; print this module again with `sidestep interface --python`") from None

    def _layout_found(self, topic, key):
        try:
            service = self._service(topic).publish_subscribe(TOPICS[topic].structure).user_header(Header).open()
        except self.iox.PublishSubscribeOpenError:
            return None  # not even size and name agree
        return "of the run " + " ".join(value.to_string() for value in service.attributes.key_values(key))

    def _event(self, topic):
        return self._service(topic).event().open()

    def _note(self, index, header):
        """What was taken since the last message sent stands in the header of the next."""
        if self.published:
            self._taken, self.published = {}, False
        entry = self._taken.setdefault((index, header.incarnation), Taken(first=header.sequence, topic=index))
        entry.last, entry.incarnation, entry.count = header.sequence, header.incarnation, entry.count + 1

    def _beat(self, state=None):
        host = host_ns()
        if state is None and host < self._beat_due_ns:
            return
        self._beat_due_ns = host + BEAT_NS
        for publisher in self._rare:
            publisher.update_connections()  # late readers get the newest message
        if self._health:
            cycles, published, taken = sum(self.counts["sent"]), self.published, self._taken
            health, self._taken = self._health.message, {}
            health.state = state or (NodeState.RUNNING if cycles else NodeState.READY)
            health.cycles = cycles
            for kind, counts in self.counts.items():
                setattr(health, kind, (ctypes.c_uint64 * TOPICS_MAX)(*counts))
            self._health.send(host)
            self.published, self._taken = published, taken

    def sleep_until(self, until_ns):
        """Waits for a host time, beating; False once the launcher has asked to leave."""
        while not self.stopping:
            self._beat()
            left_ns = until_ns - host_ns()
            if left_ns <= 0:
                return True
            time.sleep(min(left_ns, BEAT_NS) * 1e-9)
        return False

    def timeline(self, frame_hz):
        """Yields (graph time [ns], whether a frame is due) until asked to leave: ticks at 100 Hz and frames between.

        Between two values the caller publishes what belongs to that time. In lockstep each value waits for the
        arbiter's answer to the one before; in real time late ticks are not made up for.
        """
        ticks, frames, begin_ns = 0, 0, 1_000_000_000 if self.lockstep else host_ns()
        if self.lockstep and not self.begin():
            return
        while not self.stopping:
            tick_ns = begin_ns + ticks * TICK_NS
            frame_ns = begin_ns + int((frames + 0.37) * 1e9 / frame_hz)
            is_frame, now_ns = frame_ns < tick_ns, min(tick_ns, frame_ns)
            ticks, frames = ticks + (not is_frame), frames + is_frame
            if not self.lockstep:
                late_ns = host_ns() - now_ns
                begin_ns += late_ns if late_ns > 5 * TICK_NS else 0
                if self.sleep_until(now_ns):
                    yield host_ns(), is_frame
                continue
            if is_frame:
                self.say(now_ns)
            yield now_ns, is_frame
            if not is_frame:
                self.say(now_ns)
            self.answer(now_ns, frames if is_frame else 0)

    # Lockstep: graph time moves when this program says so. A tick's word of the clock comes after its odometry, since
    # it makes the arbiter step; a frame's comes before the frame.

    def begin(self):
        """Takes the clock and waits for every node of the graph; False once asked to leave."""
        self._clock, self._commands = Writer(self, "clock"), Reader(self, "command")
        way = ("local_map", "safety_map", "local_goal", "policy_command", "expert_command")
        self._way = {topic: Reader(self, topic, newest=True) for topic in way}
        waited = ["mapper", "goal", "policy", "expert", "arbiter", "recorder"]
        beats = [Reader(self, "health/" + node, newest=True) for node in waited if node in self.nodes]
        while beats and self.sleep_until(host_ns() + 5_000_000):
            beats = [reader for reader in beats if reader.newest(note=False) is None]
        return not self.stopping

    def say(self, graph_ns, **word):
        """Moves graph time, no faster than `rate_most`."""
        host0_ns, graph0_ns = self._begun = self._begun or (host_ns(), graph_ns)
        self.sleep_until(host0_ns + int((graph_ns - graph0_ns) / self.rate_most))
        self._clock.message = Clock(**{"mode": ClockMode.LOCKSTEP, "graph_ns": graph_ns, "rate": 1.0, **word})
        self._clock.send(graph_ns)

    def answer(self, graph_ns, frame=0):
        """Waits for the arbiter's command: the one of this tick, or the one that answers this frame."""
        deadline_ns = host_ns() + PATIENCE_NS
        while not self.stopping:
            self._beat()
            for command, header in self._commands.each(note=False):
                if command.answers and header.source_frame == frame if frame else header.now_ns == graph_ns:
                    return
            if host_ns() > deadline_ns:
                raise Refused(3, f"{self._silent(frame)} did not answer {f'frame {frame}' if frame else 'a tick'} for 2 s")
            self._commands.wait(0.02)

    def _silent(self, frame):
        for topic, reader in self._way.items() if frame else ():
            newest = reader.newest(note=False)
            if newest is None or newest[1].source_frame != frame:
                return TOPICS[topic].writer
        return "arbiter"


class Writer:
    """The one writer of a topic: fill `message`, then `send` it."""

    def __init__(self, link, topic):
        service, self.link, self.row = link._open(topic), link, TOPICS[topic]
        try:
            self._publisher = service.publisher_builder().max_loaned_samples(1).create()
        except link.iox.PublisherCreateError as error:
            raise Refused(3, f"topic {topic}: cannot write it: {error}; a topic has one writer") from None
        self._notifier = link._event(topic).notifier_builder().create()
        self.message, self.sequence = self.row.structure(), 0
        if self.row.history and self.row.rate_hz <= 1.0:
            link._rare.append(self._publisher)

    def send(self, now_ns, source_frame=0, status=0, received_ns=None):
        """Sends `message` as the result of a step at a graph time, and wakes its readers.

        A frame is its own source; `received_ns` is the host time at which the sensor handed it over.
        """
        link, loan = self.link, self._publisher.loan_uninit()
        received_ns = received_ns or host_ns()
        ctypes.memmove(loan.payload_ptr, ctypes.addressof(self.message), ctypes.sizeof(self.message))
        self.sequence += 1
        is_frame = self.row.name in ("depth", "scan")
        taken = sorted(link._taken.values(), key=lambda entry: (entry.topic, entry.incarnation))[:INPUTS_MAX]
        header = Header(run=link.run, incarnation=link.incarnation, sequence=self.sequence, now_ns=now_ns,
                        source_frame=self.sequence if is_frame else source_frame, status=status,
                        input_count=len(taken))
        header.inputs[: len(taken)] = taken
        if is_frame:
            header.stages[Stage.DEPTH] = StageStamp(received_ns, host_ns())
        ctypes.memmove(loan.user_header_ptr, ctypes.addressof(header), ctypes.sizeof(header))
        loan.assume_init().send()
        self._notifier.notify()
        link.counts["sent"][self.row.index] += 1
        link.published = True


class Reader:
    """A reader of a topic: of all messages, or of the newest."""

    def __init__(self, link, topic, newest=False):
        self.link, self.row, self._last, self._listener = link, TOPICS[topic], None, None
        self._gaps = link.counts["skipped" if newest else "lost"]
        builder = link._open(topic).subscriber_builder().buffer_size(1 if newest else self.row.buffer)
        try:
            self._subscriber = builder.create()
        except link.iox.SubscriberCreateError as error:
            raise Refused(3, f"topic {topic}: cannot read it: {error}; it has {self.row.readers} readers at most") from None

    def each(self, note=True):
        """Every message not taken before, oldest first, as (message, header)."""
        while True:
            sample = self._subscriber.receive()
            if sample is None:
                return
            header = Header.from_buffer_copy(sample.user_header().contents)
            message = self.row.structure.from_buffer_copy(sample.payload().contents)
            sample.delete()
            if self._last and self._last[0] == header.incarnation:
                self._gaps[self.row.index] += header.sequence - self._last[1] - 1
            self._last = (header.incarnation, header.sequence)
            if note:
                self.link._note(self.row.index, header)
            yield message, header

    def newest(self, note=True):
        """The newest message not taken before as (message, header), or None."""
        found = None
        for found in self.each(note=False):
            pass
        if found and note:
            self.link._note(self.row.index, found[1])
        return found

    def wait(self, seconds):
        """Waits for a message, beating; whether there is one."""
        self._listener = self._listener or self.link._event(self.row.name).listener_builder().create()
        until_ns = host_ns() + int(seconds * 1e9)
        self.link._beat()
        while not self._subscriber.has_samples():
            self.link._beat()
            left_ns = min(until_ns - host_ns(), BEAT_NS)
            if left_ns <= 0 or self.link.stopping:
                return False
            self._listener.timed_wait(self.link.iox.Duration.from_nanos(left_ns))
        self._listener.try_wait()
        return True
