// SPDX-License-Identifier: Apache-2.0
#pragma once
// One tetrahedron in the bytes of every format, as its specification has it. Written here and not
// by an exporter, which might turn or scale what its importer turns back.

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace nearmesh::test {

inline constexpr std::array<std::array<double, 3>, 4> kTetrahedron{
    {{1, 2, 3}, {5, 2, 3}, {1, 8, 3}, {1, 2, 13}}};
inline constexpr std::array<std::array<int, 3>, 4> kTetrahedronFaces{
    {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};

struct FormatFile {
  std::string name, ending, bytes;
  double unit_m = 1;         ///< that the file states
  bool stated = false;       ///< that it states one
  char up = '-';             ///< that the file or its format names
  bool left_handed = false;  ///< the format's; z is negated to read it
};

inline std::string number(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", x);
  return text;
}

/// All coordinates, with separators within and between points.
inline std::string points_text(const std::string& within, const std::string& between) {
  std::string text;
  for (std::size_t i = 0; i < 4; ++i) {
    if (i > 0) text += between;
    for (std::size_t k = 0; k < 3; ++k) text += (k > 0 ? within : "") + number(kTetrahedron[i][k]);
  }
  return text;
}

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

// ---- Collada ------------------------------------------------------------------------------------

/// `asset`: what stands in it, e.g. a unit and an up axis. `nodes`: of the visual scene; #g is the
/// tetrahedron.
inline std::string collada(const std::string& asset, const std::string& nodes) {
  std::string indices;
  for (const auto& face : kTetrahedronFaces)
    for (const int v : face) indices += std::to_string(v) + " ";
  return R"(<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>)" +
         asset +
         R"(</asset><library_geometries><geometry id="g"><mesh><source id="p"><float_array id="a" count="12">)" +
         points_text(" ", " ") +
         R"(</float_array><technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>)" +
         indices +
         R"(</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">)" +
         nodes +
         R"(</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
}
inline std::string collada_node(const std::string& transform = {}, const std::string& id = "n",
                                const std::string& children = {}) {
  return R"(<node id=")" + id + R"(">)" + transform + R"(<instance_geometry url="#g"/>)" +
         children + "</node>";
}

// ---- 3DS ----------------------------------------------------------------------------------------

inline std::string chunk(std::uint16_t id, const std::string& content) {
  std::string out;
  put(out, id);
  put(out, static_cast<std::uint32_t>(6 + content.size()));
  return out + content;
}
inline std::string three_ds(float master_scale) {
  std::string points, faces, scale;
  put(points, std::uint16_t{4});
  for (const auto& p : kTetrahedron)
    for (const double x : p) put(points, static_cast<float>(x));
  put(faces, std::uint16_t{4});
  for (const auto& face : kTetrahedronFaces) {
    for (const int v : face) put(faces, static_cast<std::uint16_t>(v));
    put(faces, std::uint16_t{7});
  }
  put(scale, master_scale);
  const std::string mesh = chunk(0x4100, chunk(0x4110, points) + chunk(0x4120, faces));
  return chunk(0x4D4D,
               chunk(0x3D3D, chunk(0x0100, scale) + chunk(0x4000, std::string("tri\0", 4) + mesh)));
}

// ---- FBX ----------------------------------------------------------------------------------------

inline std::string fbx(const std::string& settings) {
  std::string indices;
  for (const auto& face : kTetrahedronFaces)
    indices += (indices.empty() ? "" : ",") + std::to_string(face[0]) + "," +
               std::to_string(face[1]) + "," + std::to_string(-face[2] - 1);
  return "; FBX 7.3.0 project file\nFBXHeaderExtension:  {\n\tFBXHeaderVersion: 1003\n"
         "\tFBXVersion: 7300\n}\nGlobalSettings:  {\n\tVersion: 1000\n\tProperties70:  {\n" +
         settings +
         "\t}\n}\nObjects:  {\n\tGeometry: 1, \"Geometry::g\", \"Mesh\" {\n\t\tVertices: *12 {\n"
         "\t\t\ta: " +
         points_text(",", ",") + "\n\t\t}\n\t\tPolygonVertexIndex: *12 {\n\t\t\ta: " + indices +
         "\n\t\t}\n\t\tGeometryVersion: 124\n\t}\n\tModel: 2, \"Model::n\", \"Mesh\" {\n"
         "\t\tVersion: 232\n\t}\n}\nConnections:  {\n\tC: \"OO\",2,0\n\tC: \"OO\",1,2\n}\n";
}
/// A node of a binary FBX file: its properties' bytes, and what is below it.
struct FbxNode {
  std::string name, properties;
  std::uint32_t property_count = 0;
  std::vector<FbxNode> children{};
};
inline std::string fbx_text(const std::string& text) {
  std::string out = "S";
  put(out, static_cast<std::uint32_t>(text.size()));
  return out + text;
}
template <class T>
std::string fbx_value(char type, T value) {
  std::string out(1, type);
  put(out, value);
  return out;
}
template <class T>
std::string fbx_array(char type, const std::vector<T>& values) {
  std::string out(1, type);
  for (const std::size_t x : {values.size(), std::size_t{0}, values.size() * sizeof(T)})
    put(out, static_cast<std::uint32_t>(x));  // how many, not compressed, bytes
  for (const T value : values) put(out, value);
  return out;
}
/// `out` is the file until here: a node says where it ends.
inline void put_fbx_node(std::string& out, const FbxNode& node) {
  const std::size_t begin = out.size();
  put(out, std::uint32_t{0});
  put(out, node.property_count);
  put(out, static_cast<std::uint32_t>(node.properties.size()));
  out += static_cast<char>(node.name.size());
  out += node.name + node.properties;
  for (const FbxNode& child : node.children) put_fbx_node(out, child);
  if (!node.children.empty()) out.append(13, '\0');
  const auto end = static_cast<std::uint32_t>(out.size());
  std::memcpy(out.data() + begin, &end, sizeof end);
}
/// `settings`: of GlobalSettings.
inline std::string fbx_binary(const std::vector<FbxNode>& settings) {
  std::vector<double> points;
  std::vector<std::int32_t> indices;
  for (const auto& p : kTetrahedron) points.insert(points.end(), p.begin(), p.end());
  for (const auto& f : kTetrahedronFaces) indices.insert(indices.end(), {f[0], f[1], -f[2] - 1});
  const auto named = [](const std::string& name, const std::string& type) {
    return fbx_text(name + std::string("\0\1", 2) + type) + fbx_text("Mesh");
  };
  const auto link = [](std::int64_t from, std::int64_t to) {
    return FbxNode{"C", fbx_text("OO") + fbx_value('L', from) + fbx_value('L', to), 3};
  };
  std::string out("Kaydara FBX Binary  \0\x1a\0", 23);
  put(out, std::uint32_t{7300});
  for (const FbxNode& node :
       {FbxNode{"FBXHeaderExtension", "", 0, {{"FBXVersion", fbx_value('I', 7300), 1}}},
        FbxNode{"GlobalSettings",
                "",
                0,
                {{"Version", fbx_value('I', 1000), 1}, {"Properties70", "", 0, settings}}},
        FbxNode{"Objects",
                "",
                0,
                {{"Geometry",
                  fbx_value('L', std::int64_t{1}) + named("g", "Geometry"),
                  3,
                  {{"Vertices", fbx_array('d', points), 1},
                   {"PolygonVertexIndex", fbx_array('i', indices), 1}}},
                 {"Model",
                  fbx_value('L', std::int64_t{2}) + named("n", "Model"),
                  3,
                  {{"Version", fbx_value('I', 232), 1}}}}},
        FbxNode{"Connections", "", 0, {link(2, 0), link(1, 2)}}})
    put_fbx_node(out, node);
  return out.append(13, '\0');
}
inline FbxNode fbx_binary_unit(double centimetres) {
  return {"P",
          fbx_text("UnitScaleFactor") + fbx_text("double") + fbx_text("Number") + fbx_text("") +
              fbx_value('D', centimetres),
          5};
}
inline FbxNode fbx_binary_up(std::int32_t axis) {
  return {"P",
          fbx_text("UpAxis") + fbx_text("int") + fbx_text("Integer") + fbx_text("") +
              fbx_value('I', axis),
          5};
}
inline std::string fbx_unit(const std::string& centimetres) {
  return "\t\tP: \"UnitScaleFactor\", \"double\", \"Number\", \"\"," + centimetres + "\n";
}
inline std::string fbx_up(int axis) {
  return "\t\tP: \"UpAxis\", \"int\", \"Integer\", \"\"," + std::to_string(axis) +
         "\n\t\tP: \"UpAxisSign\", \"int\", \"Integer\", \"\",1\n";
}

// ---- glTF ---------------------------------------------------------------------------------------

inline std::string base64(const std::string& bytes) {
  constexpr const char* kLetters =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k)
      word = word << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      out += i + k <= bytes.size() ? kLetters[word >> (18 - 6 * k) & 63U] : '=';
  }
  return out;
}
inline std::string gltf_buffer() {
  std::string binary;
  for (const auto& p : kTetrahedron)
    for (const double x : p) put(binary, static_cast<float>(x));
  for (const auto& face : kTetrahedronFaces)
    for (const int v : face) put(binary, static_cast<std::uint16_t>(v));
  return binary;
}
/// `nodes`: the JSON objects of all nodes, of which the first is the scene's root; mesh 0 is the
/// tetrahedron. `where`: the buffer's bytes are.
inline std::string gltf(const std::string& nodes, const std::string& where) {
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[)" + nodes +
         R"(],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[1,2,3],"max":[5,8,13]},
{"bufferView":1,"componentType":5123,"count":12,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":24}],
"buffers":[{"byteLength":72)" +
         where + "}]}";
}
inline std::string gltf(const std::string& nodes) {
  return gltf(nodes,
              R"(,"uri":"data:application/octet-stream;base64,)" + base64(gltf_buffer()) + "\"");
}
inline std::string glb(const std::string& nodes) {
  std::string text = gltf(nodes, ""), out = "glTF";
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const std::string binary = gltf_buffer();  // 72 bytes: no padding
  put(out, std::uint32_t{2});
  put(out, static_cast<std::uint32_t>(28 + text.size() + binary.size()));
  put(out, static_cast<std::uint32_t>(text.size()));
  out += "JSON" + text;
  put(out, static_cast<std::uint32_t>(binary.size()));
  return out + std::string("BIN\0", 4) + binary;
}

// ---- 3MF ----------------------------------------------------------------------------------------

inline std::uint32_t crc32(const std::string& bytes) {
  std::uint32_t crc = 0xffffffffU;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int i = 0; i < 8; ++i) crc = crc >> 1 ^ ((crc & 1U) != 0 ? 0xedb88320U : 0U);
  }
  return ~crc;
}
/// A deflate stream of one block: each byte as the fixed code has it (RFC 1951, 3.2.6), so that
/// none stands there as it is.
inline std::string deflate(const std::string& bytes) {
  std::string out;
  unsigned used = 0;
  const auto put_bit = [&](unsigned bit) {
    if (used % 8 == 0) out += '\0';
    out.back() = static_cast<char>(static_cast<unsigned char>(out.back()) | bit << used++ % 8);
  };
  const auto put_code = [&](unsigned code, unsigned size) {
    while (size-- > 0) put_bit(code >> size & 1U);
  };
  put_code(0b110, 3);  // the last block, fixed codes
  for (const char c : bytes) {
    const unsigned byte = static_cast<unsigned char>(c);
    byte < 144 ? put_code(0x30 + byte, 8) : put_code(0x190 + byte - 144, 9);
  }
  put_code(0, 7);  // its end
  return out;
}
/// A zip archive of files that are stored as they are, or deflated.
inline std::string zip(const std::vector<std::array<std::string, 2>>& files,
                       bool is_deflated = false) {
  std::string out, directory;
  for (const auto& [name, whole] : files) {
    const std::string content = is_deflated ? deflate(whole) : whole;
    std::string common;
    for (const int x : {20, 0, is_deflated ? 8 : 0, 0, 0x21})
      put(common, static_cast<std::uint16_t>(x));
    put(common, crc32(whole));
    put(common, static_cast<std::uint32_t>(content.size()));
    put(common, static_cast<std::uint32_t>(whole.size()));
    put(common, static_cast<std::uint16_t>(name.size()));
    put(common, std::uint16_t{0});
    directory += "PK\x01\x02";
    put(directory, std::uint16_t{20});
    directory += common;
    for (int i = 0; i < 3; ++i) put(directory, std::uint16_t{0});
    put(directory, std::uint32_t{0});
    put(directory, static_cast<std::uint32_t>(out.size()));
    directory += name;
    out += "PK\x03\x04" + common + name + content;
  }
  const std::size_t start = out.size();
  out += directory + "PK\x05\x06";
  put(out, std::uint32_t{0});
  put(out, static_cast<std::uint16_t>(files.size()));
  put(out, static_cast<std::uint16_t>(files.size()));
  put(out, static_cast<std::uint32_t>(directory.size()));
  put(out, static_cast<std::uint32_t>(start));
  put(out, std::uint16_t{0});
  return out;
}
inline std::string three_mf(const std::string& unit_attribute, bool is_deflated = false) {
  std::string vertices, triangles;
  for (const auto& p : kTetrahedron)
    vertices += "<vertex x=\"" + number(p[0]) + "\" y=\"" + number(p[1]) + "\" z=\"" +
                number(p[2]) + "\"/>";
  for (const auto& f : kTetrahedronFaces)
    triangles += "<triangle v1=\"" + std::to_string(f[0]) + "\" v2=\"" + std::to_string(f[1]) +
                 "\" v3=\"" + std::to_string(f[2]) + "\"/>";
  return zip(
      {{"[Content_Types].xml",
        R"(<?xml version="1.0"?><Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types"><Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>)"},
       {"_rels/.rels",
        R"(<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/3D/3dmodel.model"/></Relationships>)"},
       {"3D/3dmodel.model",
        R"(<?xml version="1.0"?><model )" + unit_attribute +
            R"( xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1" type="model"><mesh><vertices>)" +
            vertices + "</vertices><triangles>" + triangles +
            R"(</triangles></mesh></object></resources><build><item objectid="1"/></build></model>)"}},
      is_deflated);
}
/// A Collada file in its archive.
inline std::string zae(const std::string& file) {
  return zip({{"manifest.xml", "<?xml version=\"1.0\"?><dae_root>model.dae</dae_root>"},
              {"model.dae", file}},
             true);
}

// ---- text formats -------------------------------------------------------------------------------

inline std::string obj() {
  std::string text;
  for (const auto& p : kTetrahedron)
    text += "v " + number(p[0]) + " " + number(p[1]) + " " + number(p[2]) + "\n";
  for (const auto& f : kTetrahedronFaces)
    text += "f " + std::to_string(f[0] + 1) + " " + std::to_string(f[1] + 1) + " " +
            std::to_string(f[2] + 1) + "\n";
  return text;
}
inline std::string indexed_lines(const std::string& before, const std::string& between = " ") {
  std::string text;
  for (const auto& f : kTetrahedronFaces)
    text += before + std::to_string(f[0]) + between + std::to_string(f[1]) + between +
            std::to_string(f[2]) + "\n";
  return text;
}
inline std::string off() {
  return "OFF\n4 4 0\n" + points_text(" ", "\n") + "\n" + indexed_lines("3 ");
}
inline std::string ply() {
  return "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty "
         "float "
         "z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n" +
         points_text(" ", "\n") + "\n" + indexed_lines("3 ");
}
inline std::string stl() {
  std::string text = "solid t\n";
  for (const auto& f : kTetrahedronFaces) {
    text += "facet normal 0 0 0\nouter loop\n";
    for (const int v : f) {
      const auto& p = kTetrahedron[static_cast<std::size_t>(v)];
      text += "vertex " + number(p[0]) + " " + number(p[1]) + " " + number(p[2]) + "\n";
    }
    text += "endloop\nendfacet\n";
  }
  return text + "endsolid t\n";
}
inline std::string dxf() {
  std::string text = "0\nSECTION\n2\nENTITIES\n";
  for (const auto& f : kTetrahedronFaces) {
    text += "0\n3DFACE\n8\nlayer\n";
    for (std::size_t i = 0; i < 4; ++i) {  // the last corner twice: a triangle
      const auto& p = kTetrahedron[static_cast<std::size_t>(f[std::min<std::size_t>(i, 2)])];
      for (std::size_t k = 0; k < 3; ++k)
        text += std::to_string(10 * (k + 1) + i) + "\n" + number(p[k]) + "\n";
    }
  }
  return text + "0\nENDSEC\n0\nEOF\n";
}
inline std::string ac3d() {
  std::string text =
      "AC3Db\nMATERIAL \"\" rgb 1 1 1 amb 0.2 0.2 0.2 emis 0 0 0 spec 0.5 0.5 0.5 shi 10 trans 0\n"
      "OBJECT world\nkids 1\nOBJECT poly\nname \"n\"\nnumvert 4\n" +
      points_text(" ", "\n") + "\nnumsurf 4\n";
  for (const auto& f : kTetrahedronFaces) {
    text += "SURF 0x20\nmat 0\nrefs 3\n";
    for (const int v : f) text += std::to_string(v) + " 0 0\n";
  }
  return text + "kids 0\n";
}
inline std::string direct_x() {
  std::string faces;
  // Front faces are clockwise in a left-handed frame, where the same numbers run the other way.
  for (const auto& f : kTetrahedronFaces) {
    faces += (faces.empty() ? "" : ",\n") + std::string("3;") + std::to_string(f[0]) + "," +
             std::to_string(f[1]) + "," + std::to_string(f[2]) + ";";
  }
  return "xof 0303txt 0032\nMesh n {\n4;\n" + points_text(";", ";,\n") + ";;\n4;\n" + faces +
         ";\n}\n";
}
inline std::string ase() {
  std::string text =
      "*3DSMAX_ASCIIEXPORT\t200\n*GEOMOBJECT {\n\t*NODE_NAME \"n\"\n\t*NODE_TM {\n\t\t*NODE_NAME "
      "\"n\"\n"
      "\t\t*TM_ROW0 1 0 0\n\t\t*TM_ROW1 0 1 0\n\t\t*TM_ROW2 0 0 1\n\t\t*TM_ROW3 0 0 0\n\t}\n"
      "\t*MESH {\n\t\t*TIMEVALUE 0\n\t\t*MESH_NUMVERTEX 4\n\t\t*MESH_NUMFACES "
      "4\n\t\t*MESH_VERTEX_LIST {\n";
  for (std::size_t i = 0; i < 4; ++i) {
    const auto& p = kTetrahedron[i];
    text += "\t\t\t*MESH_VERTEX " + std::to_string(i) + "\t" + number(p[0]) + "\t" + number(p[1]) +
            "\t" + number(p[2]) + "\n";
  }
  text += "\t\t}\n\t\t*MESH_FACE_LIST {\n";
  for (std::size_t i = 0; i < 4; ++i) {
    const auto& f = kTetrahedronFaces[i];
    text += "\t\t\t*MESH_FACE " + std::to_string(i) + ": A: " + std::to_string(f[0]) +
            " B: " + std::to_string(f[1]) + " C: " + std::to_string(f[2]) +
            " AB: 1 BC: 1 CA: 1 *MESH_SMOOTHING 1 *MESH_MTLID 0\n";
  }
  return text + "\t\t}\n\t}\n}\n";
}
inline std::string amf(const std::string& unit_attribute) {
  std::string text =
      "<?xml version=\"1.0\"?><amf " + unit_attribute + "><object id=\"1\"><mesh><vertices>";
  for (const auto& p : kTetrahedron)
    text += "<vertex><coordinates><x>" + number(p[0]) + "</x><y>" + number(p[1]) + "</y><z>" +
            number(p[2]) + "</z></coordinates></vertex>";
  text += "</vertices><volume>";
  for (const auto& f : kTetrahedronFaces)
    text += "<triangle><v1>" + std::to_string(f[0]) + "</v1><v2>" + std::to_string(f[1]) +
            "</v2><v3>" + std::to_string(f[2]) + "</v3></triangle>";
  return text + "</volume></mesh></object></amf>";
}

inline std::vector<FormatFile> tetrahedron_files() {
  const std::string y_up = "<up_axis>Y_UP</up_axis>", z_up = "<up_axis>Z_UP</up_axis>";
  return {
      {"PlyStatesNothing", ".ply", ply()},
      {"StlStatesNothing", ".stl", stl()},
      {"OffStatesNothing", ".off", off()},
      {"ObjStatesNothing", ".obj", obj()},
      {"ColladaYUp", ".dae", collada("<unit meter=\"1\"/>" + y_up, collada_node()), 1, true, 'y'},
      {"ColladaZUp", ".dae", collada("<unit meter=\"1\"/>" + z_up, collada_node()), 1, true, 'z'},
      {"ColladaXUp", ".dae", collada("<unit meter=\"1\"/><up_axis>X_UP</up_axis>", collada_node()),
       1, true, 'x'},
      {"ColladaZUpInches", ".dae",
       collada("<unit name=\"inch\" meter=\"0.0254\"/>" + z_up, collada_node()), 0.0254, true, 'z'},
      {"ColladaArchive", ".zae",
       zae(collada("<unit name=\"inch\" meter=\"0.0254\"/>" + z_up, collada_node())), 0.0254, true,
       'z'},
      {"ColladaWithoutUnit", ".dae", collada("", collada_node()), 1, false, 'y'},
      {"FbxCentimetres", ".fbx", fbx(fbx_unit("1") + fbx_up(1)), 0.01, true, 'y'},
      {"FbxMetresZUp", ".fbx", fbx(fbx_unit("100") + fbx_up(2)), 1, true, 'z'},
      {"FbxInches", ".fbx", fbx(fbx_unit("2.54") + fbx_up(1)), 0.0254, true, 'y'},
      {"FbxWithoutUnit", ".fbx", fbx(""), 0.01, false, 'y'},
      {"FbxBinaryInchesZUp", ".fbx", fbx_binary({fbx_binary_unit(2.54), fbx_binary_up(2)}), 0.0254,
       true, 'z'},
      {"FbxBinaryWithoutUnit", ".fbx", fbx_binary({fbx_binary_up(1)}), 0.01, false, 'y'},
      {"Gltf", ".gltf", gltf(R"({"mesh":0,"name":"n"})"), 1, true, 'y'},
      {"GltfBinary", ".glb", glb(R"({"mesh":0,"name":"n"})"), 1, true, 'y'},
      {"ThreeMfMillimetres", ".3mf", three_mf("unit=\"millimeter\""), 0.001, true, 'z'},
      {"ThreeMfInches", ".3mf", three_mf("unit=\"inch\""), 0.0254, true, 'z'},
      {"ThreeMfCompressed", ".3mf", three_mf("unit=\"inch\"", true), 0.0254, true, 'z'},
      {"ThreeMfWithoutUnit", ".3mf", three_mf(""), 0.001, false, 'z'},
      {"AmfMillimetres", ".amf", amf("unit=\"millimeter\""), 0.001, true, 'z'},
      {"AmfFeet", ".amf", amf("unit=\"feet\""), 0.3048, true, 'z'},
      {"AmfWithoutUnit", ".amf", amf(""), 0.001, false, 'z'},
      {"ThreeDs", ".3ds", three_ds(1), 1, false, 'z'},
      {"ThreeDsWithMasterScale", ".3ds", three_ds(4), 1, false, 'z'},
      {"Dxf", ".dxf", dxf(), 1, false, 'z'},
      {"Ase", ".ase", ase(), 1, false, 'z'},
      {"Ac3d", ".ac", ac3d(), 1, false, 'y'},
      {"DirectX", ".x", direct_x(), 1, false, 'y', true},
  };
}

}  // namespace nearmesh::test
