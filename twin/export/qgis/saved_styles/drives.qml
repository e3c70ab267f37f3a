<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="if(&quot;annotations_complete&quot;, 'complete', 'partial')" symbollevels="0" forceraster="0" enableorderby="0">
  <categories>
   <category symbol="0" value="complete" label="Every sign in view annotated" render="true" />
   <category symbol="1" value="partial" label="Not every sign in view annotated" render="true" />
  </categories>
  <symbols>
   <symbol type="line" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="91,112,131,255" />
      <Option name="line_style" type="QString" value="solid" />
      <Option name="line_width" type="QString" value="0.6" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="91,112,131,255" />
     <prop k="line_style" v="solid" />
     <prop k="line_width" v="0.6" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="line" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleLine" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="line_color" type="QString" value="91,112,131,255" />
      <Option name="line_style" type="QString" value="dash" />
      <Option name="line_width" type="QString" value="0.6" />
      <Option name="line_width_unit" type="QString" value="MM" />
      <Option name="capstyle" type="QString" value="round" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="line_color" v="91,112,131,255" />
     <prop k="line_style" v="dash" />
     <prop k="line_width" v="0.6" />
     <prop k="line_width_unit" v="MM" />
     <prop k="capstyle" v="round" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <fieldConfiguration />
 <aliases>
  <alias field="drive_id" index="1" name="Drive" />
  <alias field="name" index="2" name="Name" />
  <alias field="started" index="3" name="Started (UTC)" />
  <alias field="ended" index="4" name="Ended (UTC)" />
  <alias field="n_frames" index="5" name="Frames" />
  <alias field="n_sightings" index="6" name="Sightings" />
  <alias field="annotations_complete" index="7" name="Every sign in view annotated" />
  <alias field="datum" index="8" name="Datum of the GNSS" />
  <alias field="length_m" index="9" name="Length (m)" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="drive_id" editable="0" />
  <field name="name" editable="0" />
  <field name="started" editable="0" />
  <field name="ended" editable="0" />
  <field name="n_frames" editable="0" />
  <field name="n_sightings" editable="0" />
  <field name="annotations_complete" editable="0" />
  <field name="datum" editable="0" />
  <field name="length_m" editable="0" />
 </editable>
 <previewExpression>"name"</previewExpression>
 <mapTip enabled="1">&lt;b&gt;[% coalesce(nullif(replace(replace("name", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/b&gt; &amp;nbsp; [% coalesce(nullif(replace(replace("drive_id", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]
&lt;br&gt;[% coalesce(format_date("started", 'yyyy-MM-dd HH:mm:ss'), '–') %] – [% coalesce(format_date("ended", 'yyyy-MM-dd HH:mm:ss'), '–') %] UTC, [% coalesce(to_string(round("length_m", 0)) || ' m', '–') %]
&lt;br&gt;[% coalesce(to_string(round("n_sightings", 0)) || '', '–') %] sightings in [% coalesce(to_string(round("n_frames", 0)) || '', '–') %] frames,
[% if("annotations_complete", 'every sign in view annotated', 'not every sign in view annotated') %]</mapTip>
</qgis>
