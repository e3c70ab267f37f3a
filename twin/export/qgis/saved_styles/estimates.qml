<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips|Rendering" hasScaleBasedVisibilityFlag="1" minScale="10000" maxScale="0" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="CASE WHEN &quot;flags&quot; &lt;&gt; '' THEN 'flagged' ELSE 'plain' END" symbollevels="0" forceraster="0" enableorderby="0">
  <categories>
   <category symbol="0" value="plain" label="Without flags" render="true" />
   <category symbol="1" value="flagged" label="With flags" render="true" />
  </categories>
  <symbols>
   <symbol type="marker" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="27,42,65,255" />
      <Option name="size" type="QString" value="1.4" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="255,255,255,255" />
      <Option name="outline_width" type="QString" value="0.15" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="27,42,65,255" />
     <prop k="size" v="1.4" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="255,255,255,255" />
     <prop k="outline_width" v="0.15" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
   <symbol type="marker" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleMarker" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="name" type="QString" value="circle" />
      <Option name="color" type="QString" value="27,42,65,0" />
      <Option name="size" type="QString" value="1.8" />
      <Option name="size_unit" type="QString" value="MM" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_width" type="QString" value="0.4" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="miter" />
     </Option>
     <prop k="name" v="circle" />
     <prop k="color" v="27,42,65,0" />
     <prop k="size" v="1.8" />
     <prop k="size_unit" v="MM" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_width" v="0.4" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="miter" />
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <fieldConfiguration />
 <aliases>
  <alias field="estimate_id" index="1" name="Estimate" />
  <alias field="drive_id" index="2" name="Drive" />
  <alias field="object" index="3" name="Annotated object" />
  <alias field="label" index="4" name="Annotator's label" />
  <alias field="skiltnummer" index="5" name="Sign codes seen" />
  <alias field="nvdb_type" index="6" name="NVDB object type" />
  <alias field="method" index="7" name="Method" />
  <alias field="n_sightings" index="8" name="Sightings" />
  <alias field="n_frames" index="9" name="Frames" />
  <alias field="n_cameras" index="10" name="Cameras" />
  <alias field="first_seen" index="11" name="First seen (UTC)" />
  <alias field="last_seen" index="12" name="Last seen (UTC)" />
  <alias field="range_min_m" index="13" name="Shortest distance to the camera (m)" />
  <alias field="height_m" index="14" name="Ellipsoidal height (m)" />
  <alias field="height_nn2000_m" index="15" name="Height in NN2000 (m)" />
  <alias field="sigma_major_m" index="16" name="Standard deviation along the error ellipse (m)" />
  <alias field="sigma_minor_m" index="17" name="Standard deviation across the error ellipse (m)" />
  <alias field="sigma_azimuth_deg" index="18" name="Error ellipse from true north (° clockwise)" />
  <alias field="cep95_m" index="19" name="CEP95 (m)" />
  <alias field="flags" index="20" name="Flags" />
  <alias field="sigma_height_m" index="21" name="Standard deviation of the height (m)" />
  <alias field="sigma_east_m" index="22" name="Standard deviation, east (m)" />
  <alias field="sigma_north_m" index="23" name="Standard deviation, north (m)" />
  <alias field="correlation" index="24" name="Correlation of east and north" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="estimate_id" editable="0" />
  <field name="drive_id" editable="0" />
  <field name="object" editable="0" />
  <field name="label" editable="0" />
  <field name="skiltnummer" editable="0" />
  <field name="nvdb_type" editable="0" />
  <field name="method" editable="0" />
  <field name="n_sightings" editable="0" />
  <field name="n_frames" editable="0" />
  <field name="n_cameras" editable="0" />
  <field name="first_seen" editable="0" />
  <field name="last_seen" editable="0" />
  <field name="range_min_m" editable="0" />
  <field name="height_m" editable="0" />
  <field name="height_nn2000_m" editable="0" />
  <field name="sigma_major_m" editable="0" />
  <field name="sigma_minor_m" editable="0" />
  <field name="sigma_azimuth_deg" editable="0" />
  <field name="cep95_m" editable="0" />
  <field name="flags" editable="0" />
  <field name="sigma_height_m" editable="0" />
  <field name="sigma_east_m" editable="0" />
  <field name="sigma_north_m" editable="0" />
  <field name="correlation" editable="0" />
 </editable>
 <previewExpression>"object" || ' ' || "skiltnummer"</previewExpression>
 <mapTip enabled="1">&lt;b&gt;[% coalesce(nullif(replace(replace("skiltnummer", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/b&gt; &amp;nbsp; object [% coalesce(nullif(replace(replace("object", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %], drive [% coalesce(nullif(replace(replace("drive_id", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;[% coalesce(to_string(round("n_sightings", 0)) || '', '–') %] sightings in [% coalesce(to_string(round("n_frames", 0)) || '', '–') %] frames of [% coalesce(to_string(round("n_cameras", 0)) || '', '–') %] cameras, nearest [% coalesce(to_string(round("range_min_m", 1)) || ' m', '–') %]
&lt;br&gt;[% coalesce(format_date("first_seen", 'yyyy-MM-dd HH:mm:ss'), '–') %] UTC
&lt;br&gt;σ [% coalesce(to_string(round("sigma_major_m", 2)) || ' m', '–') %] × [% coalesce(to_string(round("sigma_minor_m", 2)) || ' m', '–') %], CEP95 [% coalesce(to_string(round("cep95_m", 2)) || ' m', '–') %]
&lt;br&gt;&lt;small&gt;Flags: [% coalesce(nullif(replace(replace("flags", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/small&gt;</mapTip>
</qgis>
