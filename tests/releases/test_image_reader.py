"""What has to change in a moved library, held against two other readers of such files."""

import io
import struct
import sys
from collections.abc import Callable
from typing import Any

import capstone
import pytest
from elftools.elf.elffile import ELFFile
from moved_bytes import moved

from mjbench.releases import image_reader
from mjbench.releases.moved_install import ENGINE, ImmovableError, MovableImage, MovableInstall

TWINS = {
    "vmovaps": "vmovups",
    "vmovapd": "vmovupd",
    "vmovdqa": "vmovdqu",
    "vmovntps": "vmovups",
    "vmovntpd": "vmovupd",
    "vmovntdq": "vmovdqu",
}
SHIFT = 4096 - 16  # loses the alignment of vectors, and moves content to other pages


def library(install: MovableInstall, begin: str) -> tuple[bytes, MovableImage]:
    """Return content and image of the library whose name begins so."""
    (name,) = (name for name in install.images if name.startswith(begin))
    return (install.site / "mujoco" / name).read_bytes(), install.images[name]


def elf(content: bytes) -> Any:
    return ELFFile(io.BytesIO(content))


def decoded(instruction: bytes) -> tuple[int, str, str]:
    """Return size, name and operands of the first instruction."""
    decoder = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
    _, size, name, operands = next(decoder.disasm_lite(instruction, 0))
    return size, name, operands


def test_replaced_instructions_are_the_unaligned_twins_of_aligned_ones(
    movable_install: MovableInstall,
) -> None:
    content, image = library(movable_install, ENGINE)
    changed = dict(image.unaligned.tolist())
    opcodes = [place for place in changed if place + 1 not in changed]
    assert len(opcodes) > 100
    for place in opcodes:
        begin = place - 2 if content[place - 2] == 0xC5 else place - 3
        before = content[begin : begin + 16]
        after = bytes(changed.get(begin + i, byte) for i, byte in enumerate(before))
        size, name, operands = decoded(before)
        assert "ymm" in operands and "[" in operands
        assert decoded(after) == (size, TWINS[name], operands)


def test_a_moved_library_has_nothing_left_to_replace_and_its_addresses_are_the_moved_ones(
    movable_install: MovableInstall,
) -> None:
    content, image = library(movable_install, "_functions.")
    again = image_reader.read(moved(image, content, SHIFT))
    assert len(again.unaligned) == 0
    assert again.insert_at == image.insert_at
    stay = image.addresses[image.addresses < image.insert_at]
    expected = [*stay, *(image.addresses[len(stay) :] + SHIFT)]
    assert again.addresses.tolist() == expected


@pytest.mark.parametrize("begin", [ENGINE, "_rollout."])
def test_another_reader_finds_every_symbol_segment_and_section_moved(
    movable_install: MovableInstall, begin: str
) -> None:
    content, image = library(movable_install, begin)
    before, after = elf(content), elf(moved(image, content, SHIFT))
    symbols = [file.get_section_by_name(".dynsym") for file in (before, after)]
    kinds = set()
    for old, new in zip(*(section.iter_symbols() for section in symbols), strict=True):
        stays = old["st_shndx"] in ("SHN_UNDEF", "SHN_ABS") or old["st_info"]["type"] == "STT_TLS"
        kinds.add(stays)
        assert old.name == new.name
        assert new["st_value"] - old["st_value"] == (0 if stays else SHIFT)
    assert kinds == {True, False}
    for old, new in zip(before.iter_segments(), after.iter_segments(), strict=True):
        grows = old["p_type"] == "PT_LOAD" and old["p_offset"] == 0
        stays = grows or old["p_type"] in ("PT_PHDR", "PT_GNU_STACK")
        for key in ("p_offset", "p_vaddr", "p_paddr"):
            assert new[key] - old[key] == (0 if stays else SHIFT)
        for key in ("p_filesz", "p_memsz"):
            assert new[key] - old[key] == (SHIFT if grows else 0)
    for old, new in zip(before.iter_sections(), after.iter_sections(), strict=True):
        assert new["sh_addr"] - old["sh_addr"] == (SHIFT if old["sh_addr"] else 0)
        if old.name == ".dynstr":
            assert old.data() == new.data()


def test_another_reader_finds_every_relocation_and_dynamic_address_moved(
    movable_install: MovableInstall,
) -> None:
    content, image = library(movable_install, "_rollout.")
    before, after = elf(content), elf(moved(image, content, SHIFT))
    relative = 0
    for name in (".rela.dyn", ".rela.plt"):
        tables = [file.get_section_by_name(name) for file in (before, after)]
        for old, new in zip(*(table.iter_relocations() for table in tables), strict=True):
            is_relative = old["r_info_type"] in (8, 37)
            relative += is_relative
            assert new["r_offset"] - old["r_offset"] == SHIFT
            assert new["r_addend"] - old["r_addend"] == (SHIFT if is_relative else 0)
            assert new["r_info"] == old["r_info"]
    assert relative > 100
    addresses = {".gnu.hash": "DT_GNU_HASH", ".dynsym": "DT_SYMTAB", ".init_array": "DT_INIT_ARRAY"}
    tags = {t.entry.d_tag: t.entry.d_val for t in after.get_section_by_name(".dynamic").iter_tags()}
    for section, tag in addresses.items():
        assert tags[tag] == after.get_section_by_name(section)["sh_addr"]
    old_tags = before.get_section_by_name(".dynamic").iter_tags()
    assert {t.entry.d_val for t in old_tags if t.entry.d_tag == "DT_RELASZ"} == {tags["DT_RELASZ"]}


# Files that cannot be moved.


def put(place: int, form: str, *values: int) -> Callable[[bytes], bytes]:
    """Return a function that writes numbers into content."""

    def change(content: bytes) -> bytes:
        bad = bytearray(content)
        struct.pack_into(form, bad, place, *values)
        return bytes(bad)

    return change


def in_segment(kind: int, count: int, field: int, form: str, value: int) -> Any:
    """Return a function that writes a field of the program header `count` of a kind."""

    def change(content: bytes) -> bytes:
        return put(headers(content, kind)[count] + field, form, value)(content)

    return change


def headers(content: bytes, kind: int) -> list[int]:
    """Return where the program headers of a kind are."""
    (number,) = struct.unpack_from("<H", content, 56)
    places = [64 + 56 * i for i in range(number)]
    return [place for place in places if struct.unpack_from("<I", content, place) == (kind,)]


def in_dynamic(tag: int, value: int) -> Callable[[bytes], bytes]:
    """Return a function that replaces a tag of the dynamic section."""

    def change(content: bytes) -> bytes:
        (begin,) = struct.unpack_from("<Q", content, headers(content, DYNAMIC)[0] + 8)
        while struct.unpack_from("<Q", content, begin) != (tag,):
            begin += 16
        return put(begin, "<Q", value)(content)

    return change


def with_relocation(kind: int) -> Callable[[bytes], bytes]:
    """Return a function that changes the type of the first relocation."""

    def change(content: bytes) -> bytes:
        begin = elf(content).get_section_by_name(".rela.dyn")["sh_offset"]
        return put(begin + 8, "<I", kind)(content)

    return change


def with_code_close_to_what_is_before(content: bytes) -> bytes:
    """Return content whose second segment begins 16 bytes behind the first, at another distance."""
    place = headers(content, LOAD)[1]
    (offset,) = struct.unpack_from("<Q", content, place + 8)
    return put(place + 16, "<Q", offset + 16)(content)


def with_headers_at_its_end(content: bytes) -> bytes:
    """Return content with a copy of the program headers behind it, which its header names."""
    (number,) = struct.unpack_from("<H", content, 56)
    return put(32, "<Q", len(content))(content) + content[64 : 64 + 56 * number]


LOAD, DYNAMIC, INTERP, NOTE, STACK, RELRO = 1, 2, 3, 4, 0x6474E551, 0x6474E552
BAD_FILES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "empty": (lambda content: b"", "no shared library for Linux"),
    "text": (lambda content: b"no library\n" * 100, "no shared library for Linux"),
    "truncated": (lambda content: content[: len(content) // 2], "no shared library for Linux"),
    "only a header": (lambda content: content[:64], "no shared library for Linux"),
    "another machine": (put(18, "<H", 183), "not a shared library for x86-64"),
    "an object": (put(16, "<H", 1), "not a shared library for x86-64"),
    "no sections": (put(40, "<QIHHHHHH", 0, 0, 64, 56, 9, 64, 0, 0), "no section header says"),
    "a program": (in_segment(STACK, 0, 0, "<I", INTERP), "it is a program"),
    "no segments": (put(56, "<H", 0), "has no segments"),
    "no dynamic section": (in_segment(DYNAMIC, 0, 0, "<I", NOTE), "no dynamic section"),
    "headers elsewhere": (with_headers_at_its_end, "program headers are not at its beginning"),
    "another first segment": (in_segment(LOAD, 0, 16, "<Q", 4096), "does not begin with its"),
    "segments too close": (with_code_close_to_what_is_before, "lie too close"),
    "unknown tag": (in_dynamic(7, 36), "its dynamic section has DT_RELR"),
    "unknown relocation": (with_relocation(10), "relocations of type 10"),
}


@pytest.fixture
def small(movable_install: MovableInstall, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """Return the content of a small library; its code is not decoded, to save time."""
    monkeypatch.setattr(image_reader, "unaligned_twins", lambda content, sections: ())
    return library(movable_install, "_rollout.")[0]


@pytest.mark.parametrize(("change", "message"), BAD_FILES.values(), ids=BAD_FILES)
def test_what_cannot_be_moved_is_refused_in_one_line(
    small: bytes, change: Callable[[bytes], bytes], message: str
) -> None:
    with pytest.raises(ImmovableError) as caught:
        image_reader.read(change(small))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 200


def test_segments_that_come_to_share_a_page_permit_what_either_needs(small: bytes) -> None:
    """GNU ld puts constants (read) on the page behind code (read and execute)."""
    first, second = headers(small, LOAD)[:2]
    (offset,) = struct.unpack_from("<Q", small, second + 8)
    content = put(first + 4, "<I", 5)(small)
    content = put(second + 4, "<I", 4)(content)
    assert len(image_reader.read(content).permissions) == 0  # they are pages apart
    content = put(second + 16, "<Q", offset)(content)
    assert image_reader.read(content).permissions.tolist() == [[second + 4, 5]]


def test_what_the_loader_would_make_read_only_stays_executable_on_a_page_with_code(
    small: bytes,
) -> None:
    """The code of `_rollout` in MuJoCo 3.2.6 ends where a page ends, and data begin there."""
    first, second = headers(small, LOAD)[:2]
    (relro,) = headers(small, RELRO)
    (offset,) = struct.unpack_from("<Q", small, second + 8)
    content = put(first + 4, "<I", 5)(small)
    content = put(second + 4, "<I", 6)(content)
    content = put(second + 16, "<Q", offset)(content)
    content = put(relro + 16, "<Q", offset)(content)
    expected = [[second + 4, 7], *([relro + i, 0] for i in range(4))]
    assert image_reader.read(content).permissions.tolist() == expected


@pytest.mark.parametrize(
    ("module", "name"), [("capstone", "capstone"), ("elftools.elf.elffile", "pyelftools")]
)
def test_a_missing_package_is_named(
    movable_install: MovableInstall, monkeypatch: pytest.MonkeyPatch, module: str, name: str
) -> None:
    content, _ = library(movable_install, "_rollout.")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImmovableError, match=f"^{name} is not installed$"):
        image_reader.read(content)


@pytest.mark.parametrize(
    ("instruction", "message"),
    [
        ("62f17c482800", "aligned to 64 bytes"),  # vmovaps zmm0, [rax]
        ("62f17d48e700", "aligned to 64 bytes"),  # vmovntdq [rax], zmm0
        ("c4e27d2a00", "c4e27d2a00 needs aligned data"),  # vmovntdqa ymm0, [rax]
        ("62f17c282800", "62f17c282800 needs aligned data"),  # vmovaps ymm0, [rax], as AVX-512
        ("06", "no known instruction"),
    ],
)
def test_code_that_could_break_when_it_is_moved_is_refused(instruction: str, message: str) -> None:
    code = bytes.fromhex(instruction) + b"\x90" * 8
    with pytest.raises(ImmovableError, match=message):
        list(image_reader.unaligned_twins(code, [(0, len(code))]))


@pytest.mark.parametrize(
    ("aligned", "unaligned"),
    [
        ("c5fc2800", "c5fc1000"),  # vmovaps ymm0, [rax]
        ("c5fd2900", "c5fd1100"),  # vmovapd [rax], ymm0
        ("c57d6f4108", "c57e6f4108"),  # vmovdqa ymm8, [rcx + 8]
        ("c4c17d7f0424", "c4c17e7f0424"),  # vmovdqa [r12], ymm0
        ("c5fde700", "c5fe7f00"),  # vmovntdq [rax], ymm0
        ("c5fc2b00", "c5fc1100"),  # vmovntps [rax], ymm0
        ("c5fc28c1", "c5fc28c1"),  # between registers
        ("c5f82800", "c5f82800"),  # 16 bytes, which stay aligned
    ],
)
def test_each_aligned_instruction_has_a_twin(aligned: str, unaligned: str) -> None:
    code = bytearray(bytes.fromhex(aligned))
    for place, byte in image_reader.unaligned_twins(bytes(code), [(0, len(code))]):
        code[place] = byte
    assert code.hex() == unaligned
