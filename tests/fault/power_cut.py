# SPDX-License-Identifier: Apache-2.0
"""
Power cuts: the states of a disk after one, derived from a recording of a run (inject_record.c).

    with power_cut.recorded(test, root) as recording: ...programs run...; recording.mark("done")
    run = power_cut.Run(recording, root_before)
    for cut, image in run.images(limits, seed): ...image.write(folder)...

The model, after ALICE (Pillai et al., "All File Systems Are Not Created Equal", OSDI 2014) and
CrashMonkey (Mohan et al., OSDI 2018), for a file system that promises no more than POSIX:

- A write, a truncation and the growth of a file are certain once the file has been synced (fsync,
  fdatasync) or everything (syncfs). Until then each may be on the disk or not, in any combination.
- A write that is not certain may be there in part: any of its sectors of 512 bytes. A file may have
  grown without the bytes: they read as zeros, or as what the disk held before (here 0xA5).
- A name (created, removed, renamed, a folder made) is certain once its folder has been synced, or
  everything. Syncing a file says nothing about its name. Until then each may be there or not, in any
  combination; of changes to one name later ones win.
- A rename within a folder is atomic. One between folders may leave both names, never none.

Not in the model: disks that report a flush falsely; torn sectors; damage
to bytes that were certain; maps that are written (SQLite's -shm is left out of images: it is not
read after a crash). Recorded processes must not be killed while they write.

A cut is looked at right before each sync and before each reply, and at the end: between two of
those an earlier cut gives no image that the later one does not give as well. Of n uncertain changes
all 2^n subsets are made while that is at most `exact`; beyond it none, all, each prefix, each one
left out, each one alone, and a seeded sample.
"""
import atexit
import contextlib
import ctypes
import hashlib
import itertools
import os
import random
import shutil
import struct

import fault_sweep as fs
from fault_sweep import ut

LOG_BYTES = 1 << 28  # sparse
SECTOR = 512
(OPEN, WRITE, TRUNCATE, SYNC, SYNC_ALL, RENAME, MKDIR, UNLINK, MAP, SEND, MARK) = range(1, 12)
NEVER = 1 << 60


class Recording:
    """The log of a run, and marks put into it by the test."""

    def __init__(self, path, library):
        self.path, self.library = path, library

    def mark(self, word):
        self.library.record_mark(word.encode())

    def entries(self):
        """[(kind, inode, offset, path, other, data)] in the order in which they took effect."""
        with open(self.path, "rb") as file:
            used, _, full = struct.unpack("<QII", file.read(16))
            assert not full, "the log was too small"
            log = file.read(used)
        at, found = 0, []
        while at < used:
            size, kind, inode, offset, path, other, data, _ = struct.unpack_from("<IIQQIIIi", log, at)
            words = at + 40
            found.append((kind, inode, offset, log[words:words + path].decode(),
                          log[words + path:words + path + other].decode(),
                          log[words + path + other:words + path + other + data]))
            at += size
        return found


@contextlib.contextmanager
def recorded(test, root):
    """Programs that start inside are recorded, below root; gives the Recording."""
    path = test.path(f"record{len(os.listdir(test.folder))}")
    with open(path, "wb") as file:
        file.truncate(LOG_BYTES)
    values = {"LD_PRELOAD": ut.program("inject.so"), "UMBRAGE_FAULT_RECORD": path,
              "UMBRAGE_FAULT_UNDER": root}
    os.environ.update(values)
    # Each recording has a library of its own: a library that is loaded keeps its log.
    copy = path + ".so"
    shutil.copy(values["LD_PRELOAD"], copy)
    try:
        yield Recording(path, ctypes.CDLL(copy))
    finally:
        for name in values:
            del os.environ[name]


class Node:
    """A file or a folder; base: what is certain, pending: the numbers of changes that are not."""

    def __init__(self, number, is_folder, data=b""):
        self.number, self.is_folder = number, is_folder
        self.live = {} if is_folder else bytearray(data)
        self.base = {} if is_folder else bytes(data)
        self.pending = []
        self.mapped = False


class Change:
    """A change of a folder's names {name: node or None}, or of a file's bytes at an offset
    (data None: its size becomes offset). after: a change that must be there if this one is."""

    def __init__(self, index, node, names=None, offset=0, data=None, after=None):
        self.index, self.node, self.names = index, node, names
        self.offset, self.data, self.after = offset, data, after

    def apply(self, value, how):
        """How: True, or a set of sectors, or "zeros" or "stale" for growth without the bytes."""
        if self.names is not None:
            for name, node in self.names.items():
                if node is None:
                    value.pop(name, None)
                else:
                    value[name] = node
        elif self.data is None:
            del value[self.offset:]
            value.extend(bytes(self.offset - len(value)))
        elif how in ("zeros", "stale"):
            end = self.offset + len(self.data)
            value.extend((b"\0" if how == "zeros" else b"\xa5") * (end - len(value)))
        elif how is True:
            self.put(value, self.offset, self.data)
        else:
            for sector in sorted(how):
                low = max(self.offset, sector * SECTOR)
                high = min(self.offset + len(self.data), (sector + 1) * SECTOR)
                self.put(value, low, self.data[low - self.offset:high - self.offset])

    @staticmethod
    def put(value, offset, data):
        if offset > len(value):
            value.extend(bytes(offset - len(value)))
        value[offset:offset + len(data)] = data

    def sectors(self):
        return range(self.offset // SECTOR, (self.offset + len(self.data) - 1) // SECTOR + 1)


class Image:
    """One state that the disk may hold: {path: bytes, or None for a folder}."""

    def __init__(self, files, what):
        self.files, self.what = files, what
        text = hashlib.sha256()
        for path in sorted(files):
            data = files[path]
            text.update(path.encode() + b"\0" + (b"/" if data is None else hashlib.sha256(data).digest()))
        self.digest = text.digest()

    def write(self, folder):
        shutil.rmtree(folder, ignore_errors=True)
        os.makedirs(folder)
        for path in sorted(self.files):
            data = self.files[path]
            if data is None:
                os.mkdir(os.path.join(folder, path))
            else:
                with open(os.path.join(folder, path), "wb") as file:
                    file.write(data)

    def names(self, folder=""):
        """Names of the files in a folder of the image."""
        return [os.path.basename(path) for path, data in self.files.items()
                if data is not None and os.path.dirname(path) == folder]


def snapshot(root):
    """What lies below a folder before a run: [(path, inode, bytes or None)], parents first."""
    found = []
    for folder, folders, names in os.walk(root):
        for name in sorted(folders) + sorted(names):
            path = os.path.join(folder, name)
            data = None
            if name in names:
                with open(path, "rb") as file:
                    data = file.read()
            found.append((os.path.relpath(path, root), os.lstat(path).st_ino, data))
    return found


class Run:
    """A recording, followed: cuts, and at each the changes that are not certain."""

    def __init__(self, recording, root, before=()):
        self.root_path = root
        self.count = itertools.count()
        self.root = Node(next(self.count), True)
        self.by_inode = {os.lstat(root).st_ino: self.root}
        self.changes, self.cuts, self.sent, self.marks = [], [], [], []
        for path, inode, data in before:
            parent, name = self.place(os.path.join(root, path))
            node = self.by_inode[inode] = Node(next(self.count), data is None, data or b"")
            parent.live[name] = parent.base[name] = node
        for index, entry in enumerate(recording.entries()):
            self.follow(index, *entry)
        self.cut(index + 1)
        self.compare()

    # ---- following the log ----

    def place(self, path):
        """The folder and the name of an absolute path below the root; None if it lies elsewhere."""
        words = [word for word in os.path.relpath(path, self.root_path).split("/") if word != "."]
        if not words or words[0] == "..":
            return None, None
        node = self.root
        for word in words[:-1]:
            node = node.live[word]
        return node, words[-1]

    def change(self, index, node, **what):
        change = Change(index, node, **what)
        change.apply(node.live, True)
        node.pending.append(change)
        self.changes.append(change)
        return change

    def add(self, index, parent, name, is_folder, inode):
        node = self.by_inode[inode] = Node(next(self.count), is_folder)
        self.change(index, parent, names={name: node})

    def rename(self, index, path, other):
        parent, name = self.place(path)
        target, new = self.place(other)
        assert parent is not None and target is not None, f"renamed out of the root: {path} {other}"
        node = parent.live[name]
        if parent is target:
            if name != new:
                self.change(index, parent, names={name: None, new: node})
            return
        made = self.change(index, target, names={new: node})
        self.change(index, parent, names={name: None}, after=made)

    def certain(self, node):
        value = dict(node.base) if node.is_folder else bytearray(node.base)
        for change in node.pending:
            change.apply(value, True)
        node.base = value if node.is_folder else bytes(value)
        node.pending = []

    def follow(self, index, kind, inode, offset, path, other, data):
        node = self.by_inode.get(inode)
        if kind in (SYNC, SYNC_ALL) and (node is not None or kind == SYNC_ALL):
            self.cut(index)
            for synced in [node] if kind == SYNC else {c.node for c in self.pending()}:
                self.certain(synced)
        elif kind == OPEN:
            parent, name = self.place(path)
            if name not in parent.live:
                self.add(index, parent, name, False, inode)
            elif offset and len(parent.live[name].live) > 0:
                self.change(index, parent.live[name], offset=0)
        elif kind == MKDIR:
            parent, name = self.place(path)
            if parent is not None:
                self.add(index, parent, name, True, inode)
        elif kind == UNLINK:
            parent, name = self.place(path)
            self.change(index, parent, names={name: None})
        elif kind == RENAME:
            self.rename(index, path, other)
        elif kind == WRITE and node is not None:
            self.change(index, node, offset=offset, data=data)
        elif kind == TRUNCATE and node is not None and offset != len(node.live):
            self.change(index, node, offset=offset)
        elif kind == MAP and node is not None:
            node.mapped = True
        elif kind in (SEND, MARK):
            self.cut(index)
            (self.sent if kind == SEND else self.marks).append((index, data))

    def pending(self):
        return [change for change in self.changes if change in change.node.pending]

    def cut(self, index):
        """Keeps what is needed to make the images of a cut before entry `index`."""
        changes = sorted(self.pending(), key=lambda change: change.index)
        self.changes = list(changes)
        shape = [(change.index, id(change)) for change in changes]
        if self.cuts and self.cuts[-1][3] == shape and self.same_base(self.cuts[-1][2]):
            self.cuts[-1] = (index, *self.cuts[-1][1:])  # the later one: it owes more
            return
        nodes = {}
        self.collect(self.root, nodes)
        self.cuts.append((index, changes, {node: node.base for node in nodes.values()}, shape))

    def same_base(self, bases):
        return all(node.base is base for node, base in bases.items())

    def collect(self, node, nodes):
        """All nodes that an image may reach: by certain names, and by those that are not."""
        if node.number in nodes:
            return
        nodes[node.number] = node
        if node.is_folder:
            below = list(node.base.values())
            for change in node.pending:
                below += [child for child in change.names.values() if child is not None]
            for child in below:
                self.collect(child, nodes)

    def compare(self):
        """Checks that the recording, replayed completely, gives what lies on the disk: no operation
        was missed."""
        live = {}
        self.walk(self.root, "", lambda node: node.live, live)
        found = {path: data for path, _, data in snapshot(self.root_path)}
        mapped = {path for path, node in self.paths(self.root, "") if node.mapped}
        assert all(path.endswith("-shm") for path in mapped), f"written by maps: {mapped}"
        left_out = {path for path in {*live, *found} if path.endswith("-shm")}
        assert {*live} - left_out == {*found} - left_out, f"names: {sorted({*live} ^ {*found})}"
        for path in {*live} - left_out:
            assert live[path] == found[path], f"{path}: other bytes than were recorded"

    def paths(self, node, path):
        for name, child in node.live.items():
            yield path + name, child
            if child.is_folder:
                yield from self.paths(child, path + name + "/")

    def walk(self, node, path, value_of, files, depth=0):
        assert depth < 64, "a folder in itself"
        for name, child in value_of(node).items():
            if child.is_folder:
                files[path + name] = None
                self.walk(child, path + name + "/", value_of, files, depth + 1)
            elif not name.endswith("-shm"):
                files[path + name] = bytes(value_of(child))

    # ---- images ----

    def image(self, cut, chosen):
        """chosen: {change: how}, of the cut's changes."""
        index, changes, bases, _ = cut
        values = {}
        for change in changes:
            how = chosen.get(change)
            if how is not None and not (change.after in changes and change.after not in chosen):
                node = change.node
                if node not in values:
                    base = bases.get(node, node.base if node not in bases else None)
                    values[node] = dict(base) if node.is_folder else bytearray(base)
                change.apply(values[node], how)
        files = {}
        self.walk(self.root, "", lambda node: values.get(node, bases.get(node, node.base)), files)
        return Image(files, f"cut before entry {index}, {len(chosen)} of {len(changes)} changes")

    def choices(self, cut, exact, sample, rng):
        """Choices of one cut, see the head of this file."""
        changes = cut[1]
        count = len(changes)
        if 1 << min(count, 40) <= exact:
            for bits in range(1 << count):
                yield {c: True for i, c in enumerate(changes) if bits >> i & 1}
        else:
            whole = dict.fromkeys(changes, True)
            yield {}
            yield whole
            singles = changes if count <= sample else rng.sample(changes, sample)
            for change in singles:
                yield {c: True for c in changes if c.index < change.index}
                yield {c: True for c in changes if c is not change}
                yield {change: True}
            for _ in range(sample):
                share = rng.random()
                yield {c: True for c in changes if rng.random() < share}
        yield from self.torn(changes, sample, rng)

    @staticmethod
    def torn(changes, sample, rng):
        """Writes in part; the other changes all there, or some."""
        writes = [c for c in changes if c.data is not None]
        for _ in range(min(sample, 4 * len(writes))):
            victim = rng.choice(writes)
            share = rng.choice((1, 1, 0.5))
            chosen = {c: True for c in changes if c is not victim and rng.random() < share}
            sectors = victim.sectors()
            some = {s for s in sectors if rng.random() < 0.5}
            chosen[victim] = rng.choice(("zeros", "stale", some, {sectors[0]}, {sectors[-1]}))
            yield chosen

    def images(self, exact, sample, seed):
        """(index, Image) of every cut; the same image comes once for each cut that can leave it."""
        rng = random.Random(seed)
        for cut in self.cuts:
            seen = set()
            for chosen in self.choices(cut, exact, sample, rng):
                image = self.image(cut, chosen)
                if image.digest not in seen:
                    seen.add(image.digest)
                    yield cut[0], image

    # ---- what was promised, and when ----

    def first_sent(self, words):
        """Index of the entry that first sends these bytes to a socket; NEVER if none does."""
        return next((index for index, data in self.sent if words in data), NEVER)

    def marked(self, word):
        return next((index for index, data in self.marks if data == word.encode()), NEVER)


def folder_for_images(test):
    """Returns a folder in memory, if there is a file system for that: thousands of images are
    written."""
    if os.access("/dev/shm", os.W_OK):
        folder = f"/dev/shm/umbrage-cut{os.getpid()}"
        atexit.register(shutil.rmtree, folder, True)
    else:
        folder = test.path("images")
    os.makedirs(folder, exist_ok=True)
    return folder
