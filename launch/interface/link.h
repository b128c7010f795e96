/* ---- the run that started this program ----------------------------------------------------------------------------

   The launcher has created every service; a driver only opens them. With the C API of iceoryx2 (this version):

     iox2_config_h config = NULL;
     iox2_config_default(NULL, &config);
     iox2_config_global_set_prefix(&config, getenv(SIDESTEP_DOMAIN));
     iox2_config_global_set_root_path(&config, getenv(SIDESTEP_ROOT));
     iox2_config_global_node_set_cleanup_dead_nodes_on_creation(&config, false);      only the launcher cleans up
     iox2_config_global_node_set_cleanup_dead_nodes_on_destruction(&config, false);
     iox2_config_global_service_set_cleanup_dead_nodes_on_open(&config, false);
     iox2_node_builder_set_config(&node_builder, &config);

   For each topic, from its row in sidestep_topics:

     service name                row->service, for messages and for the event that wakes readers
     payload type                row->type_name, FIXED_SIZE, row->size bytes, alignment 8 (SIDESTEP_ALIGNMENT)
     user header type            SIDESTEP_HEADER_NAME, FIXED_SIZE, sizeof(Header), alignment 8
     attribute verifier          iox2_attribute_verifier_require(&verifier, "layout", row->layout)
     open                        iox2_service_builder_pub_sub_open_with_attributes(...); never create
     subscriber                  buffer size row->buffer for all messages, 1 for the newest
     publisher                   one per topic: a second is refused
     after each send             iox2_notifier_notify(...) on the event of the same name

   A driver publishes `depth` or `scan`, `odometry` at 100 Hz, `ranges` where it has them, and `path`; it obeys `command`.
   Without a message on `health/<node>` it counts as ready at its first message and is never killed for its silence. */

#define SIDESTEP_DOMAIN "SIDESTEP_DOMAIN"           /* prefix of every shared-memory object of the run */
#define SIDESTEP_ROOT "SIDESTEP_ROOT"               /* folder of the run */
#define SIDESTEP_RUN "SIDESTEP_RUN"                 /* number of the run, for Header.run */
#define SIDESTEP_NODE "SIDESTEP_NODE"               /* name of this node in the graph file */
#define SIDESTEP_INCARNATION "SIDESTEP_INCARNATION" /* restarts so far, for Header.incarnation */
#define SIDESTEP_GRAPH "SIDESTEP_GRAPH"             /* path of the resolved graph file */
#define SIDESTEP_ROBOT "SIDESTEP_ROBOT"             /* path of the robot file */

/* A number that the launcher passed; 0 where it is missing. */
static inline uint64_t sidestep_number(const char *variable)
{
    const char *text = getenv(variable);
    return text ? strtoull(text, NULL, 10) : 0;
}

#ifdef CLOCK_MONOTONIC
/* [ns] host time; graph time too, unless `clock` says otherwise. Needs _POSIX_C_SOURCE 199309L before the first include. */
static inline uint64_t sidestep_host_ns(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}
#endif

/* [ns] graph time at a host time, from the newest `clock`; without one (NULL) it is host time. */
static inline uint64_t sidestep_graph_ns(const Clock *clock, uint64_t host_ns)
{
    if (!clock || clock->mode == SIDESTEP_CLOCK_MODE_REAL_TIME)
        return host_ns;
    if (clock->mode == SIDESTEP_CLOCK_MODE_LOCKSTEP || clock->paused)
        return clock->graph_ns;
    uint64_t passed_ns = host_ns > clock->host0_ns ? host_ns - clock->host0_ns : 0;
    return clock->graph0_ns + (uint64_t)((double)passed_ns * clock->rate);
}

/* What the wheels must do now: the newest command until its valid_until_ns, then brake to a stop. */
static inline Twist sidestep_obey(const Command *newest, uint64_t graph_ns)
{
    Twist stop = {0, 0};
    return newest && graph_ns < newest->valid_until_ns ? newest->twist : stop;
}

/* The header of a message. `sequence` counts from 1 per topic; a frame (depth, scan) is its own source and carries the
   host times at which the sensor handed it over and at which it is sent, other topics of a driver give 0 for both. */
static inline Header sidestep_header(uint64_t sequence, uint64_t now_ns, uint64_t received_ns, uint64_t send_ns)
{
    Header header;
    memset(&header, 0, sizeof header);
    header.run = sidestep_number(SIDESTEP_RUN);
    header.incarnation = (uint32_t)sidestep_number(SIDESTEP_INCARNATION);
    header.sequence = sequence;
    header.now_ns = now_ns;
    if (send_ns) {
        header.source_frame = sequence;
        header.stages[SIDESTEP_STAGE_DEPTH].receive_ns = received_ns;
        header.stages[SIDESTEP_STAGE_DEPTH].send_ns = send_ns;
    }
    return header;
}
