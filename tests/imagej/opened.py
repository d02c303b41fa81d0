"""Open files in ImageJ and by Bio-Formats: python opened.py IJ.jar BIOFORMATS.jar OUT.npz FILE...

Prints what each program shows of each file as JSON; OUT.npz gets the pixels, named PROGRAM:FILE.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import jpype
import numpy as np
import tifffile

SCHEMA = "released-schema/2016-06/ome.xsd"  # in the jar of Bio-Formats
QUIET = Path(__file__).with_name("logback.xml")


def opened(program: str, name: str) -> Iterator[object]:
    """The images of a file as `ij.ImagePlus`."""
    if program == "imagej":
        image = jpype.JClass("ij.IJ").openImage(name)
        if image is not None:
            yield image
    elif name.endswith(".tif"):
        options = jpype.JClass("loci.plugins.in.ImporterOptions")()
        options.setId(name)
        options.setColorMode("Composite")
        yield from jpype.JClass("loci.plugins.BF").openImagePlus(options)


def shown(image) -> dict[str, object]:
    """What ImageJ shows of an image."""
    stack, scale = image.getStack(), image.getCalibration()
    luts = image.getLuts() if image.isComposite() else []
    return {
        "bits": int(image.getBitDepth()),
        "grey": bool(image.getType() in (image.GRAY8, image.GRAY16, image.GRAY32)),
        "channels": int(image.getNChannels()),
        "slices": int(image.getStackSize()),
        "labels": [str(stack.getSliceLabel(i + 1)) for i in range(stack.getSize())],
        "unit": str(scale.getUnit()),
        "width": float(scale.pixelWidth),
        "height": float(scale.pixelHeight),
        "limits": [float(image.getDisplayRangeMin()), float(image.getDisplayRangeMax())],
        "colours": [np.array(lut.getBytes()).view("u1")[255::256].tolist() for lut in luts],
        "info": str(image.getProperty("Info")),
    }


def pixels(image) -> np.ndarray:
    """(slices, H, W) values."""
    stack = image.getStack()
    shape = (image.getHeight(), image.getWidth())
    return np.stack(
        [np.array(stack.getPixels(i + 1)).reshape(shape) for i in range(stack.getSize())]
    )


def channel_names(name: str) -> list[str]:
    """The names of the channels in the OME model of Bio-Formats."""
    reader = jpype.JClass("loci.formats.ImageReader")()
    metadata = jpype.JClass("loci.formats.MetadataTools").createOMEXMLMetadata()
    reader.setMetadataStore(metadata)
    reader.setId(name)
    names = [str(metadata.getChannelName(0, i)) for i in range(reader.getSizeC())]
    reader.close()
    return names


def schema_error(name: str) -> str | None:
    """What the OME schema of 2016 says against the XML of a file."""
    with tifffile.TiffFile(name) as tiff:
        text = jpype.JClass("java.io.StringReader")(tiff.pages.first.description)
    xsd = jpype.JClass("java.lang.ClassLoader").getSystemResource(SCHEMA)
    factory = jpype.JClass("javax.xml.validation.SchemaFactory")
    schema = factory.newInstance("http://www.w3.org/2001/XMLSchema").newSchema(xsd)
    try:
        schema.newValidator().validate(
            jpype.JClass("javax.xml.transform.stream.StreamSource")(text)
        )
    except jpype.JException as error:
        return str(error)
    return None


def main(imagej: str, bioformats: str, output: str, *names: str) -> None:
    jpype.startJVM(
        "-Djava.awt.headless=true",
        f"-Dlogback.configurationFile={QUIET}",
        "-Xmx512m",
        classpath=[imagej, bioformats],
    )
    about, arrays = {}, {}
    for name in names:
        for program in ("imagej", "bioformats"):
            for image in opened(program, name):
                about[f"{program}:{Path(name).name}"] = shown(image)
                arrays[f"{program}:{Path(name).name}"] = pixels(image)
        if name.endswith(".ome.tif"):
            shown_of_set = about[f"bioformats:{Path(name).name}"]
            shown_of_set["names"] = channel_names(name)
            shown_of_set["schema_error"] = schema_error(name)
    np.savez(output, **arrays)
    print(json.dumps(about))


main(*sys.argv[1:])
