"""The paper's algorithm: a ray walks the cyclic graph itself.

Section 3 of Gervautz and Traxler. Selections are evaluated, calculations run on an array of
parameters, transformations map the ray by inverse matrices, and a chain of references to them is
kept for the normal of the first hit (fig 4). Hyper-bounding boxes end what the ray misses.

Below unions only, the walker keeps the first crossing it has found and shrinks the ray to it.
Below intersections and differences, and for whole intervals, it builds lists of events and merges
them. Both are defined by ``docs/solids.md``. Memory is proportional to the depth of the recursion
(and, for lists, to the number of events).
"""

from __future__ import annotations

import math

import numpy as np

from pcsg.graph.operators import DIFFERENCE, INTERSECTION, UNION
from pcsg.graph.tape import run
from pcsg.graph.transforms import evaluate_transform
from pcsg.jit import njit
from pcsg.leaf.dispatch import leaf_crossings, leaf_inside
from pcsg.leaf.registry import ALL, ANY, OVERFLOW, Pool
from pcsg.trace.merge import CROSSING, SHEET, TABLES, merge
from pcsg.trace.precision import is_touch, load_precision, tolerance
from pcsg.trace.tables import (
    CALCULATION,
    CONSTANT_MATRIX,
    LEAF,
    MATRIX,
    MAX_LEAF_ARGS,
    SELECTION,
    Tables,
)
from pcsg.trace.walk_space import (
    BAD_ARGUMENT,
    CHAIN_FULL,
    CROSSINGS_FULL,
    EVENTS_FULL,
    F_CHAIN,
    F_CHAIN_TOP,
    F_DEPTH,
    F_FLIP,
    F_LISTS,
    F_MIDDLE,
    F_NEXT,
    F_NODE,
    F_RECORD_TOP,
    F_START,
    FRAME,
    FRAMES_FULL,
    OK,
    PRECISION,
    RECORD,
    RECORDS_FULL,
    SELECTION_RANGE,
    SHRUNK_DIRECTION,
    SHRUNK_ORIGIN,
    SINGULAR,
    STATE,
    TOO_DEEP,
    TOO_LONG,
    Scratch,
    args_are_legal,
    chain_map,
    copy_record,
    describe_record,
    find_model,
    leave_events,
    misses_box,
    note_fault,
    restore_state,
    save_state,
    write_record,
)
from pcsg.vec import (
    Ray,
    Vec3,
    compose,
    invert,
    load_affine,
    store_affine,
    transform_point,
    transform_ray,
)

# Ways of walking.
SHRINK, LIST, MEMBERSHIP = 0, 1, 2

_UNION, _INTERSECTION, _DIFFERENCE = UNION.kind, INTERSECTION.kind, DIFFERENCE.kind


@njit
def walk(
    tables: Tables, pool: Pool, scratch: Scratch, way: int, want: int, world: Ray
) -> tuple[int, int]:
    """Walk the graph with one ray.

    Parameters
    ----------
    way
        SHRINK: keep the first crossing only. LIST: build the list of all events in about
        [tmin, tmax]. MEMBERSHIP: as LIST, with everything or nothing for leaves that contain the
        ray's origin or do not.
    want
        For SHRINK: FIRST or ANY.
    world
        The ray in world coordinates.

    Returns
    -------
    status, n
        OK or what went wrong. For SHRINK, n is 1 if record 0 and `Scratch.best` hold a hit, 0 for
        a miss, -1 if the ray starts inside or on a solid, so that only a list can tell. For LIST
        and MEMBERSHIP the number of events.
    """
    kind_of, detail_of, code_at = tables.kind, tables.detail, tables.code_at
    first, count, edges = tables.first, tables.degree, tables.edges
    boxed, boxes = tables.boxed, tables.boxes
    code, constants, code_stack = tables.code, tables.constants, scratch.stack
    matrices, forwards = tables.matrices, tables.forwards
    frame_slot, attribute_slot = tables.frame_slot, tables.attribute_slot
    frames, states = scratch.frames, scratch.states
    chain_of, chain_matrices = scratch.chain, scratch.chain_matrices
    event_t, event_about = scratch.event_t, scratch.event_about
    records, record_about = scratch.records, scratch.record_about
    params, ends, first_hit, fault = scratch.params, scratch.t, scratch.best, scratch.fault
    n_params = len(tables.initial)
    width = STATE + n_params
    max_frames = len(frames) // FRAME
    max_chain = len(chain_of) // 3
    max_events = len(event_t)
    max_records = len(record_about) // 3
    for k in range(n_params):
        params[k] = tables.initial[k]

    precision = load_precision(scratch.best, PRECISION)
    touch = world.tmin + tolerance(world.tmin, precision)
    near = world.tmin - 2.0 * tolerance(world.tmin, precision)
    far = world.tmax + 2.0 * tolerance(world.tmax, precision)
    best = far
    found = 0
    ray = world
    origin = Vec3(0.0, 0.0, 0.0)
    node = 0
    chain = -1
    chain_top = 0
    record_top = 1
    event_top = 0
    flip = 0
    depth = 0
    visits = 0
    frame_top = 0
    lists = way != SHRINK

    while True:
        # Down to a leaf, or to something empty.
        while True:
            kind = kind_of[node]
            if boxed[node] == 1:
                if way == MEMBERSHIP:
                    at = 6 * node
                    if not (
                        boxes[at] <= ray.ox <= boxes[at + 3]
                        and boxes[at + 1] <= ray.oy <= boxes[at + 4]
                        and boxes[at + 2] <= ray.oz <= boxes[at + 5]
                    ):
                        break
                elif misses_box(boxes, 6 * node, ray, near, best):
                    break
            if kind == SELECTION:
                depth += 1
                if depth > tables.depth_limit:
                    note_fault(fault, node, -1, chain)
                    return TOO_DEEP, 0
                visits += 1
                if visits > tables.visit_limit:
                    note_fault(fault, node, -1, chain)
                    return TOO_LONG, 0
                if (
                    max(abs(origin.x), abs(origin.y), abs(origin.z)) > SHRUNK_ORIGIN
                    or max(abs(ray.dx), abs(ray.dy), abs(ray.dz)) > SHRUNK_DIRECTION
                ):
                    break
            if code_at[node] >= 0:
                status, at = run(code, constants, code_at[node], frame_slot, params, 0, code_stack)
                if status != OK:
                    note_fault(fault, node, at, chain)
                    return status, 0
            if kind == SELECTION:
                rule = np.rint(scratch.stack[0])
                if not (rule >= 1.0 and rule <= count[node]):
                    note_fault(fault, node, -1, chain)
                    return SELECTION_RANGE, 0
                below = edges[first[node] + int(rule) - 1]
                if below < 0:
                    note_fault(fault, node, -1, chain)
                    return SELECTION_RANGE, 0
                if chain_top == max_chain:
                    return CHAIN_FULL, 0
                chain_of[3 * chain_top] = chain
                chain_of[3 * chain_top + 1] = node
                chain_of[3 * chain_top + 2] = int(rule)
                chain = chain_top
                chain_top += 1
                node = below
            elif kind == CALCULATION:
                node = edges[first[node]]
            elif kind in (CONSTANT_MATRIX, MATRIX):
                if chain_top == max_chain:
                    return CHAIN_FULL, 0
                if kind == CONSTANT_MATRIX:
                    forward = load_affine(forwards, detail_of[node])
                    inverse = load_affine(matrices, detail_of[node])
                else:
                    forward = evaluate_transform(detail_of[node], code_stack)
                    inverse, regular = invert(forward)
                    if not regular:
                        note_fault(fault, node, -1, chain)
                        return SINGULAR, 0
                    store_affine(chain_matrices, 12 * chain_top, inverse)
                if frame_slot >= 0:
                    frame = load_affine(params, frame_slot)
                    store_affine(params, frame_slot, compose(frame, forward))
                chain_of[3 * chain_top] = chain
                chain_of[3 * chain_top + 1] = node
                chain_of[3 * chain_top + 2] = 0
                chain = chain_top
                chain_top += 1
                ray = transform_ray(inverse, ray)
                origin = transform_point(inverse, origin)
                node = edges[first[node]]
            elif kind == LEAF:
                solid = detail_of[node]
                args = tables.args
                args_at = tables.args_at[node]
                arity = tables.arity[solid]
                if tables.models_at[node] >= 0:
                    args_at = find_model(tables.models, tables.models_at[node], code_stack)
                    if args_at < 0:
                        note_fault(fault, node, -1, chain)
                        return BAD_ARGUMENT, 0
                elif code_at[node] >= 0:
                    args = code_stack
                    args_at = 0
                    at = solid * MAX_LEAF_ARGS
                    if not args_are_legal(tables.low, tables.high, at, args, arity):
                        note_fault(fault, node, -1, chain)
                        return BAD_ARGUMENT, 0
                sheet = tables.sheet[node] == 1
                if way == MEMBERSHIP:
                    n = 0
                    point = Vec3(ray.ox, ray.oy, ray.oz)
                    if leaf_inside(solid, point, args, args_at, pool):
                        ends[0], ends[1] = -math.inf, math.inf
                        n = 2
                else:
                    asked = ALL
                    if not lists:
                        asked = want
                        low = world.tmin if sheet else near
                        ray = Ray(ray.ox, ray.oy, ray.oz, ray.dx, ray.dy, ray.dz, low, best)
                    n = leaf_crossings(solid, ray, asked, args, args_at, pool, ends, 0)
                    if n == OVERFLOW:
                        return CROSSINGS_FULL, 0
                used = False
                for k in range(0, n, 2):
                    lo, hi = ends[k], ends[k + 1]
                    if not sheet and is_touch(lo, hi):
                        continue
                    if lists:
                        if lo > best or hi < near:
                            continue
                        if event_top + 2 > max_events:
                            return EVENTS_FULL, 0
                        if record_top == max_records:
                            return RECORDS_FULL, 0
                        event_t[event_top] = lo
                        event_about[2 * event_top] = record_top
                        event_about[2 * event_top + 1] = SHEET if sheet else CROSSING
                        event_top += 1
                        if not sheet:
                            event_t[event_top] = hi
                            event_about[2 * event_top] = record_top
                            event_about[2 * event_top + 1] = CROSSING
                            event_top += 1
                        used = True
                        continue
                    if not sheet and hi < near:
                        continue
                    if not sheet and lo <= touch:
                        return OK, -1
                    if lo < world.tmin or lo > world.tmax:
                        continue
                    if found == 0 or lo < best - tolerance(
                        best, load_precision(first_hit, PRECISION)
                    ):
                        found = 1
                        first_hit[0] = lo
                        write_record(records, 0, ray, params, attribute_slot, args, args_at, arity)
                        describe_record(record_about, 0, node, chain, flip)
                        m = chain_map(kind_of, detail_of, matrices, chain_of, chain_matrices, chain)
                        store_affine(first_hit, 1, m)
                        best = lo
                        if want == ANY:
                            # Only a solid about the start could still hide it.
                            best = touch
                    break
                if used:
                    at = record_top * RECORD
                    write_record(records, at, ray, params, attribute_slot, args, args_at, arity)
                    describe_record(record_about, record_top, node, chain, flip)
                    record_top += 1
                break
            else:
                # Into the first operand; a frame waits with what the others need.
                if frame_top == max_frames:
                    return FRAMES_FULL, 0
                at = frame_top * FRAME
                frames[at + F_NODE] = node
                frames[at + F_NEXT] = 1
                frames[at + F_CHAIN] = chain
                frames[at + F_FLIP] = flip
                frames[at + F_DEPTH] = depth
                frames[at + F_CHAIN_TOP] = chain_top
                frames[at + F_RECORD_TOP] = record_top
                frames[at + F_START] = event_top
                frames[at + F_MIDDLE] = event_top
                frames[at + F_LISTS] = 1 if lists else 0
                save_state(states, frame_top * width, ray, origin, params, n_params)
                frame_top += 1
                if detail_of[node] != _UNION:
                    lists = True
                node = edges[first[node]]

        # Up to the next operation that has operands left.
        resumed = False
        while frame_top > 0:
            top = (frame_top - 1) * FRAME
            node = frames[top + F_NODE]
            operator = detail_of[node]
            done = frames[top + F_NEXT]
            start = frames[top + F_START]
            middle = frames[top + F_MIDDLE]
            if not lists:
                chain_top = frames[top + F_CHAIN_TOP]
            else:
                if done > 1 and event_top > middle > start:
                    n = merge(
                        TABLES[operator],
                        event_t,
                        event_about,
                        start,
                        middle,
                        middle,
                        event_top,
                        scratch.merged_t,
                        scratch.merged_about,
                        load_precision(first_hit, PRECISION),
                    )
                    for k in range(n):
                        event_t[start + k] = scratch.merged_t[k]
                        event_about[2 * (start + k)] = scratch.merged_about[2 * k]
                        event_about[2 * (start + k) + 1] = scratch.merged_about[2 * k + 1]
                    event_top = start + n
                elif done > 1 and event_top == middle and operator == _INTERSECTION:
                    event_top = start
                if event_top == start:
                    chain_top = frames[top + F_CHAIN_TOP]
                    record_top = frames[top + F_RECORD_TOP]
                    if operator != _UNION:
                        done = count[node]
            if done < count[node]:
                chain = frames[top + F_CHAIN]
                flip = frames[top + F_FLIP]
                depth = frames[top + F_DEPTH]
                ray, origin = restore_state(
                    states, (frame_top - 1) * width, world, params, n_params
                )
                frames[top + F_NEXT] = done + 1
                frames[top + F_MIDDLE] = event_top
                if operator == _DIFFERENCE:
                    flip = 1 - flip
                if not lists and done + 1 == count[node]:
                    frame_top -= 1
                node = edges[first[node] + done]
                resumed = True
                break
            frame_top -= 1
            if lists and frames[top + F_LISTS] == 0:
                # The outermost operation with lists is complete: its first event counts.
                lists = False
                inside = False
                for k in range(event_top):
                    t = event_t[k]
                    sheet = event_about[2 * k + 1] == SHEET
                    if not sheet:
                        inside = not inside
                        starts_within = inside and t <= touch
                        if starts_within and event_t[leave_events(event_about, k)] >= near:
                            return OK, -1
                    if t < world.tmin or t > world.tmax:
                        continue
                    if found == 0 or t < best - tolerance(
                        best, load_precision(first_hit, PRECISION)
                    ):
                        found = 1
                        first_hit[0] = t
                        copy_record(records, record_about, event_about[2 * k])
                        end = record_about[1]
                        m = chain_map(kind_of, detail_of, matrices, chain_of, chain_matrices, end)
                        store_affine(first_hit, 1, m)
                        best = t
                        if want == ANY:
                            best = touch
                    break
                event_top = 0
                record_top = 1
                chain_top = frames[top + F_CHAIN_TOP]
        if not resumed:
            return OK, (event_top if way != SHRINK else found)
